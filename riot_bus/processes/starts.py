"""How a component is started: as a process of this machine, in a container, on another machine; or it runs already."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import stat
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.processes.attached import attached_command
from riot_bus.processes.containers import container_commands, engine_of
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set
    from pathlib import Path

    from riot_bus.system.system_file import Component, RemoteHost

_OPTIONS = ("BatchMode=yes", "ExitOnForwardFailure=yes", "ServerAliveInterval=5", "ServerAliveCountMax=3")
_THERE = "exec 3<&0; {{ cat <&3; kill -9 0; }} >/dev/null 2>&1 & cd {cwd} && {own}env {call} </dev/null 3<&-; exit $?\n"
"""Script there. All of the process group is killed when standard input ends, as it does with the connection."""


class Start(NamedTuple):
    """How a component is started.

    Attributes:
        argv: Command that is executed on this machine: the component's own, or one such as `docker run` or `ssh`.
        container: Name of the container; empty if it runs in none.
        script: Text on the standard input of `argv`, which then stays open, so that the component ends with the
            connection; None if it has no input.
        relayed: Whether `argv` passes on the component's status as a shell does: 128 plus the number of a signal.
        lost: Status of `argv` that means that the container's engine or the connection has failed, not the component;
            None if there is none.
    """

    argv: Sequence[str]
    teardown: Sequence[str] = ()
    engine: str = ""
    container: str = ""
    script: str | None = None
    relayed: bool = False
    lost: int | None = None


def start_of(
    component: Component,
    called: str,
    *,
    argv: Sequence[str],
    env: Mapping[str, str],
    endpoint: str,
    there: str,
    folder: Path,
    cwd: Path,
) -> Start:
    """Return how a component is started.

    Args:
        env: Variables that riot.toml gives it, and those of the surroundings; a container or another machine adds
            its own.
        there: Endpoint from the component's view: the same, unless it runs on another machine.
    """
    if component.container is not None:
        run, remove = container_commands(component.container, called, command=argv, env=env, folder=folder, cwd=cwd)
        if component.teardown:
            remove = ["sh", "-c", f"{shlex.join(remove)}; {shlex.join(component.teardown)}"]
        # 125: the engine, not the program, has failed
        return Start(run, remove, engine_of(component.container), called, relayed=True, lost=125)
    if component.ssh is not None:
        words, script = ssh_command(component.ssh, endpoint, there, command=argv, env=env, cwd=component.cwd)
        # 255: the connection, not the command, has failed
        return Start(words, component.teardown, script=script, relayed=True, lost=255)
    if component.attach is not None:
        return Start(attached_command(int(component.attach.rpartition(":")[2])), component.teardown, lost=1)
    return Start(argv, component.teardown)


def ssh_command(
    remote: RemoteHost, endpoint: str, there: str, *, command: Sequence[str], env: Mapping[str, str], cwd: str
) -> tuple[list[str], str]:
    """Return what executes a component's command on another machine, where it finds the segment.

    It is a command and the script on its standard input, which has to stay open as long as the component is to run. So
    no value of a variable is on a command line, which every user of either machine could see.

    Args:
        there: Endpoint on the other machine: a loopback port that is forwarded to the segment.
        cwd: Working folder there, relative to the folder of a login.

    Raises:
        ConfigError: The segment does not listen on TCP, so `ssh` cannot forward to it.
    """
    protocol, _, address = endpoint.partition("/")
    if protocol != "tcp":
        raise ConfigError(f"ssh forwards TCP alone, and the segment listens at {endpoint}", where="[components] ssh")
    options = [word for option in _OPTIONS for word in ("-o", option)]
    forward = f"{there.removeprefix('tcp/')}:{address}"
    own = f"export {shlex.join(f'{key}={value}' for key, value in env.items())} && " if env else ""
    script = _THERE.format(cwd=shlex.quote(cwd), own=own, call=shlex.join(command))
    return ["ssh", "-T", *options, "-R", forward, *remote.options, remote.host, "sh"], script


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
