"""ROS domains that bridges join to the segments of the router of `riot ros-test`."""

from __future__ import annotations

import json
import signal
from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from riot_bus.processes.ros_domains import start_bridge
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until
from riot_bus_bridges.ros2.node import START_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from riot_bus.processes.launcher import ComponentProcess, Launcher

_END_S = 15.0  # a bridge waits up to 5 s for its last messages, and 10 s for its node
LOOK_S = 0.05  # a look reads all that the bridge has printed; a start takes far longer


@contextmanager
def bridged_domains(
    launcher: Launcher, endpoints: Mapping[str, str], domains: Mapping[str, int], *, folder: Path
) -> Iterator[Counter[str]]:
    """Join a ROS domain to each segment until the context ends; messages in transit then are still forwarded.

    Yields counts that are filled at the end: how many messages of each topic a bridge has carried into its domain.

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


def _wait_ready(launcher: Launcher, bridge: ComponentProcess) -> None:
    wait_until(lambda: bool(_event(bridge, "ready")) or not launcher.alive(bridge), START_S, interval=LOOK_S)
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
