"""Which components can be forked from a fork server that has imported their modules, and what the server needs."""

from __future__ import annotations

import os
import re
import shutil
import stat
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set
    from pathlib import Path

_PYTHON = re.compile(r"python(\d+(\.\d+)?)?$")
_OPTION = re.compile(r"-([bBdEiIOPqRsSuv]+|[WX].+)$")
_WITH_WORD = ("-W", "-X")
_READ_AT_START = ("PYTHON", "LD_")
_OF_A_TRIAL = "RIOT_TRIAL_"
_WORD = re.compile(r"\w+")
_BEGINNING = 2048
"""Bytes of a script that are read: the scripts that pip and setuptools write for installed programs are shorter."""
_NO_PYTHON = "its command is not a Python script or module"


class Fork(NamedTuple):
    """How a component is forked.

    Attributes:
        env: Environment of the server: that of the component without what differs from trial to trial.
        own: Folder in which the component looks for modules first.
        words: Further words of its command line, including the name of a script.
    """

    interpreter: Sequence[str]
    env: Mapping[str, str]
    modules: Sequence[str]
    own: str
    module: str | None
    words: Sequence[str]


def fork_of(
    argv: Sequence[str], *, env: Mapping[str, str], varying: Set[str], cwd: Path, modules: Sequence[str]
) -> Fork | str:
    """Return how a component is forked, or why it is not; an empty string as long as its imports are unknown."""
    if not modules or not argv:
        return ""
    argv = _interpreted(argv, env, cwd)
    if not _PYTHON.match(os.path.basename(argv[0])):
        return _NO_PYTHON
    if early := [name for name in varying if name.startswith(_READ_AT_START)]:
        return f"{', '.join(sorted(early))} differs from trial to trial"
    env = {name: value for name, value in env.items() if name not in varying and not name.startswith(_OF_A_TRIAL)}
    at = 1
    while at < len(argv) and (_OPTION.match(argv[at]) or argv[at] in _WITH_WORD):
        at += 1 + (argv[at] in _WITH_WORD)
    interpreter, rest = argv[:at], argv[at:]
    if len(rest) > 1 and rest[0] == "-m":
        return Fork(interpreter, env, modules, str(cwd), rest[1], rest[2:])
    if not rest:
        return _NO_PYTHON
    script = os.path.realpath(cwd / rest[0])
    if not rest[0].endswith(".py"):
        text = _beginning(script)
        if not text or b"\0" in text:  # a folder, an archive, or compiled
            return _NO_PYTHON
        if len(text) < _BEGINNING:  # an installed program names its own package, which each process imports anew
            named = set(_WORD.findall(text.decode(errors="replace").replace("-", "_")))
            modules = [name for name in modules if name.partition(".")[0] not in named]
    return Fork(interpreter, env, modules, os.path.dirname(script), None, rest)


def _interpreted(argv: Sequence[str], env: Mapping[str, str], cwd: Path) -> Sequence[str]:
    """Return the command that the kernel executes for a script with a `#!` line; any other command is unchanged."""
    path = argv[0] if os.sep in argv[0] else shutil.which(argv[0], path=env.get("PATH")) or argv[0]
    line, end, _ = _beginning(cwd / path).partition(b"\n")
    if not (line.startswith(b"#!") and end and os.access(cwd / path, os.X_OK)):
        return argv
    words = line[2:].decode(errors="surrogateescape").strip().split(maxsplit=1)
    if len(words) > 1 and os.path.basename(words[0]) == "env":
        words = words[1].removeprefix("-S").split() if words[1].startswith("-S") else words[1:]
    return [*words, path, *argv[1:]] if words else argv


def _beginning(path: str | Path) -> bytes:
    """Return the first bytes of a regular file, nothing of anything else."""
    try:
        if stat.S_ISREG(os.stat(path).st_mode):
            with open(path, "rb") as stream:
                return stream.read(_BEGINNING)
    except OSError:
        pass
    return b""
