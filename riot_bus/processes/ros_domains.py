"""ROS domains for nodes that use DDS: unused ones, and bridges that join one to a segment."""

from __future__ import annotations

import random
import socket
import sys
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import environment_of_others

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from riot_bus.processes.launcher import ComponentProcess, Launcher


_DOMAINS = range(1, 101)  # not 0, everybody's; above 101, ports may belong to clients (32,768 and more on Linux)


def riot_command() -> list[str]:
    """Return the command that starts this same riot again, whatever `PYTHONPATH` the user's ROS environment sets."""
    return [sys.executable, "-E", "-P", "-m", "riot_bus"]


def domain_environment(domain: int, folder: Path) -> dict[str, str]:
    """Return the variables of nodes in a domain of this machine that write their logs into a folder.

    They do not use shared memory, since that of nodes that are killed stays.
    """
    return {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }


def start_bridge(
    launcher: Launcher, name: str, *, endpoint: str, domain: int, folder: Path, parameters: Iterable[str] = ()
) -> ComponentProcess:
    """Start a bridge that joins a ROS domain to a segment."""
    options = [
        *(f"--parameters={node}" for node in parameters),
        f"--domain={domain}",
        f"--endpoint={endpoint}",
        "--format=json",
    ]
    command = [*riot_command(), "bridge", "ros2", *options]
    return launcher.start(name, command, env=environment_of_others(), cwd=folder, directory=folder)


@contextmanager
def free_domains(count: int) -> Iterator[list[int]]:
    """Reserve domains that no other tests and no participants on this machine use, until the context ends.

    Raises:
        EnvironmentFaultError: Fewer domains than that are free.
    """
    with ExitStack() as stack:
        found: list[int] = []
        for number in random.SystemRandom().sample(_DOMAINS, len(_DOMAINS)):
            if len(found) == count:
                break
            with suppress(OSError):
                stack.enter_context(_taken(number))
                found.append(number)
        if len(found) < count:
            raise EnvironmentFaultError("all ROS domains from 1 to 100 are in use", hint="end some ROS nodes")
        yield found


@contextmanager
def _taken(number: int) -> Iterator[None]:
    with socket.socket() as lock, socket.socket(type=socket.SOCK_DGRAM) as probe:
        lock.bind(("", 32_768 + number))  # as ROS's domain_coordinator and colcon's do
        probe.bind(("", 7400 + 250 * number))  # on which participants of DDS discover each other
        probe.close()
        yield
