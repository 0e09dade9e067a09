"""Which components can be forked from a server that has imported what they import, and what that server needs."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set
    from pathlib import Path

__all__ = ["Fork", "fork_of"]

_PYTHON = re.compile(r"python(\d+(\.\d+)?)?$")
_OPTION = re.compile(r"-([bBdEiIOPqRsSuv]+|[WX].+)$")
_WITH_WORD = ("-W", "-X")
_READ_AT_START = ("PYTHON", "LD_")
_OF_A_TRIAL = "RIOT_TRIAL_"


class Fork(NamedTuple):
    """How a component is forked.

    Attributes:
        interpreter: Command of its Python, with the options of the interpreter.
        env: Environment of the server: that of the component without what differs from trial to trial.
        modules: Modules that the component imports, in their order.
        own: Folder in which the component looks for modules first.
        module: Module that it runs, None for a script.
        words: What follows on its command line, a script's name included.
    """

    interpreter: Sequence[str]
    env: Mapping[str, str]
    modules: Sequence[str]
    own: str
    module: str | None
    words: Sequence[str]


def fork_of(
    argv: Sequence[str], *, env: Mapping[str, str], varying: Set[str], cwd: Path, modules: Sequence[str]
) -> Fork | None:
    """Return how a component is forked; None if its command is not that of a Python script or module.

    Args:
        argv: Its command.
        env: Its environment.
        varying: Variables that differ from trial to trial.
        cwd: Its working folder.
        modules: Modules that it imports, as an earlier trial has shown; nothing is forked without.
    """
    if not modules or not argv or not _PYTHON.match(os.path.basename(argv[0])):
        return None
    if any(name.startswith(_READ_AT_START) for name in varying):
        return None
    env = {name: value for name, value in env.items() if name not in varying and not name.startswith(_OF_A_TRIAL)}
    at = 1
    while at < len(argv) and (_OPTION.match(argv[at]) or argv[at] in _WITH_WORD):
        at += 1 + (argv[at] in _WITH_WORD)
    interpreter, rest = argv[:at], argv[at:]
    if len(rest) > 1 and rest[0] == "-m":
        return Fork(interpreter, env, modules, str(cwd), rest[1], rest[2:])
    if rest and rest[0].endswith(".py"):
        script = os.path.realpath(cwd / rest[0])
        return Fork(interpreter, env, modules, os.path.dirname(script), None, rest)
    return None
