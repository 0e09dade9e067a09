"""How a component is started: as a process of this machine, in a container, on another machine; or it runs already."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.processes.attached import attached_command
from riot_bus.processes.containers import container_commands, engine_of
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.system.system_file import Component, RemoteHost

_OPTIONS = ("BatchMode=yes", "ExitOnForwardFailure=yes", "ServerAliveInterval=5", "ServerAliveCountMax=3")
_THERE = "exec 3<&0; {{ cat <&3; kill -9 0; }} >/dev/null 2>&1 & cd {cwd} && {own}env {call} </dev/null 3<&-; exit $?\n"
"""Script there. All of the process group is killed when standard input ends, as it does with the connection."""


class Start(NamedTuple):
    """How a component is started.

    Attributes:
        argv: Command that is executed on this machine: the component's own, or one such as `docker run` or `ssh`.
        teardown: Command that is executed when `argv` has ended; empty for none.
        engine: Program that runs the component's container, such as `docker`; empty if it runs in none.
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
        component: Settings of the component in riot.toml, with placeholders filled in.
        called: Name that its container gets, if it runs in one.
        argv: Command of the component.
        env: Variables that riot.toml gives it, and those of the surroundings; a container or another machine adds
            its own.
        endpoint: Endpoint of its segment.
        there: Endpoint from the component's view: the same, unless it runs on another machine.
        folder: Folder of the trial.
        cwd: Folder in which the command is executed.

    Raises:
        ConfigError: The component cannot be started so on this machine.
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
        remote: The other machine.
        endpoint: Endpoint of the segment on this machine.
        there: Endpoint on the other machine: a loopback port that is forwarded to the segment.
        command: Command to execute there.
        env: Variables that the command gets there.
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
