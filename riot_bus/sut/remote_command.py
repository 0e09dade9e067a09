"""Components on another machine: the `ssh` command that runs one there, and ends it whatever happens on this side."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.sut.system import RemoteHost

__all__ = ["CONNECTION_LOST", "ssh_command"]

CONNECTION_LOST = 255
"""Status of `ssh` when the connection, not the command, has failed."""
_OPTIONS = ("BatchMode=yes", "ExitOnForwardFailure=yes", "ServerAliveInterval=5", "ServerAliveCountMax=3")
_THERE = "exec 3<&0; {{ cat <&3; kill -9 0; }} >/dev/null 2>&1 & cd {cwd} && env {command} </dev/null 3<&-; exit $?"
"""All of the process group is killed when standard input ends, as it does with the connection."""


def ssh_command(
    remote: RemoteHost, endpoint: str, there: str, *, command: Sequence[str], env: Mapping[str, str], cwd: str
) -> list[str]:
    """Return the command that executes a component's command on another machine, where it finds the segment.

    Its standard input has to stay open as long as the component is to run.

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
    words = shlex.join([*(f"{key}={value}" for key, value in env.items()), *command])
    executed = f"sh -c {shlex.quote(_THERE.format(cwd=shlex.quote(cwd), command=words))}"
    return ["ssh", "-T", *options, "-R", forward, *remote.options, remote.host, executed]
