"""ROS domains for nodes that use DDS: unused ones, and bridges that join them to segments of the router."""

from __future__ import annotations

import json
import random
import signal
import socket
from collections import Counter
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any

from riot_bus.sut.existing_tests.packages import riot_command
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import environment_of_others, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from riot_bus.sut.launcher import ComponentProcess, Launcher

__all__ = ["bridged_domains", "domain_environment", "free_domains", "start_bridge"]

_READY_S = 60.0  # as long as the bridge itself waits for its node, which imports rclpy
_END_S = 15.0  # a bridge waits up to 5 s for its last messages, and 10 s for its node
_LOOK_S = 0.05  # a look reads all that the bridge has printed; a start takes far longer
_DOMAINS = range(1, 101)
_LOCK_PORT = 32_768
"""A domain is taken by binding this port plus its number, as ROS's domain_coordinator and colcon's do."""
_DDS_PORT, _PORTS_OF_DOMAIN = 7400, 250
"""First port, and distance between domains, of the ports on which participants discover each other."""


@contextmanager
def bridged_domains(
    launcher: Launcher, endpoints: Mapping[str, str], domains: Mapping[str, int], *, folder: Path
) -> Iterator[Counter[str]]:
    """Join a ROS domain to each segment until the context ends; messages in transit then are still forwarded.

    Yields counts that are filled at the end: how many messages of each topic a bridge has carried into its domain.

    Args:
        launcher: Owner of the processes.
        endpoints: Endpoint of each segment.
        domains: ROS domain of each segment.
        folder: Folder for the output of the bridges.

    Raises:
        EnvironmentFaultError: A bridge does not start, such as for lack of rclpy.
    """
    bridges = [
        start_bridge(launcher, f"bridge-{segment}", endpoint=endpoints[segment], domain=domain, folder=folder)
        for segment, domain in domains.items()
    ]
    for bridge in bridges:
        _wait_ready(launcher, bridge)
    carried: Counter[str] = Counter()
    try:
        yield carried
    finally:
        for bridge in bridges:
            launcher.interrupt(bridge, signal.SIGINT)
        launcher.wait(bridges, timeout=_END_S)
        for bridge in bridges:
            topics = _event(bridge, "ended").get("topics", {})
            carried.update({topic: ways["to_domain"] for topic, ways in topics.items()})


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
    """Start a bridge that joins a ROS domain to a segment.

    Args:
        launcher: Owner of the process.
        name: Name of the bridge.
        endpoint: Endpoint of the segment.
        domain: Number of the domain.
        folder: Folder for its output.
        parameters: Nodes whose parameters are set from the segment.
    """
    options = [
        *(f"--parameters={node}" for node in parameters),
        f"--domain={domain}",
        f"--endpoint={endpoint}",
        "--format=json",
    ]
    command = [*riot_command(), "bridge", "ros2", *options]
    return launcher.start(name, command, env=environment_of_others(), cwd=folder, directory=folder)


def _wait_ready(launcher: Launcher, bridge: ComponentProcess) -> None:
    wait_until(lambda: bool(_event(bridge, "ready")) or not launcher.alive(bridge), _READY_S, interval=_LOOK_S)
    if not _event(bridge, "ready"):
        why = bridge.errors().strip().splitlines() or ["it says nothing"]
        hint = "RIOT_ROS_PYTHON or RIOT_ROS_SETUP name a Python that has rclpy (docs/ros2.md)"
        raise EnvironmentFaultError(f"no bridge to DDS: {' '.join(why[-4:])}", where="--dds", hint=hint)


def _event(bridge: ComponentProcess, name: str) -> dict[str, Any]:
    """Return what a bridge has said so far of an event; nothing if it has not."""
    for line in bridge.printed().splitlines(keepends=True):
        if line.startswith("{") and line.endswith("\n") and (event := json.loads(line)).get("event") == name:
            return dict(event)
    return {}


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
        lock.bind(("", _LOCK_PORT + number))
        probe.bind(("", _DDS_PORT + _PORTS_OF_DOMAIN * number))
        probe.close()
        yield
