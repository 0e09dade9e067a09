"""The two segments of the router of `riot ros-test`: placement of processes, connected components, and crossings.

Only a message with a subscriber in another segment passes the router: within one segment, messages bypass riot.
"""

from __future__ import annotations

import json
import signal
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.segment_environment import export, segment_variables, write_session_files
from riot_bus.processes.ros_domains import free_domains, start_bridge
from riot_bus.router.receivers import Receivers
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import environment_of_others, includes, wait_until
from riot_bus_bridges.ros2.node import START_S
from riot_bus_bridges.ros_test.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path

    from riot_bus.control.router_service import RouterService
    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.router.bus import Bus

HERE, UNIT = "system", "unit"
"""The segment of the command, and that of the chosen processes."""


@dataclass(frozen=True, slots=True)
class ReadySegments:
    """Segments that are ready for a command.

    Attributes:
        carried: Number of messages that bridges have carried into a domain, by topic; known at the end.
    """

    environment: Mapping[str, str]
    placement: Placement
    domains: Mapping[str, int]
    carried: Mapping[str, int]


_END_S = 15.0  # a bridge waits up to 5 s for its last messages, and 10 s for its node
LOOK_S = 0.05  # a look reads all that the bridge has printed; a start takes far longer


@contextmanager
def bridged_domains(
    launcher: Launcher, endpoints: Mapping[str, str], domains: Mapping[str, int], *, folder: Path
) -> Iterator[Counter[str]]:
    """Join a ROS domain to each segment until the context ends; messages in transit then are still forwarded.

    Yields counts that are filled at the end: how many messages of each topic a bridge has carried into its domain.
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


@contextmanager
def open_segments(
    service: RouterService, launcher: Launcher, folder: Path, *, nodes: str | None, dds: bool
) -> Iterator[ReadySegments]:
    """Make the segments of a running router ready for a command.

    Raises:
        ConfigError: `nodes` is not a regular expression.
        EnvironmentFaultError: A bridge does not start.
    """
    endpoints = {name: service.bus.segment(name).endpoints for name in service.settings.segments}
    domains: dict[str, int] = {}
    carried: Mapping[str, int] = {}
    with ExitStack() as stack:
        if dds:
            domains = dict(zip(endpoints, stack.enter_context(free_domains(len(endpoints))), strict=True))
            first = {name: found[0] for name, found in endpoints.items()}
            carried = stack.enter_context(bridged_domains(launcher, first, domains, folder=folder))
        write_session_files(endpoints, folder)
        given = {**environment_of_others(), **export(endpoints, files=folder, domains=domains)}
        placement = Placement(folder, segment=UNIT, nodes=nodes, variables=segment_variables(UNIT, given))
        environment = {**given, **segment_variables(HERE, given), **placement.environment(given)}
        yield ReadySegments(environment, placement, domains, carried)


class Components:
    """The components that have connected so far, without those that were connected before."""

    def __init__(self, service: RouterService) -> None:
        self._service = service
        self._before = self._peers()
        self._seen: dict[str, set[str]] = {name: set() for name in self._before}

    def _peers(self) -> dict[str, set[str]]:
        bus = self._service.bus
        return {name: bus.segment(name).peers() - bus.ids_ever for name in self._service.settings.segments}

    def look(self) -> None:
        """Note the components that are connected now."""
        for name, found in self._peers().items():
            self._seen[name] |= found - self._before[name]

    @property
    def found(self) -> dict[str, int]:
        """Number of components by segment, without empty segments."""
        return {name: len(found) for name, found in self._seen.items() if found}


class Crossings:
    """Notes in which segments intercepted keys ever had a subscriber, even briefly; a context manager."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._receivers = Receivers(bus)

    def __enter__(self) -> Self:
        for expression in self._bus.intercepted:
            self._receivers.watch(expression)
        return self

    def __exit__(self, *error: object) -> None:
        self._receivers.__exit__(*error)

    def count(self, inhabited: Collection[str]) -> int:
        """Return how many messages came from one segment and had a subscriber in another one.

        Args:
            inhabited: Segments that have components: a recorder of everything looks like a subscriber in each.
        """
        heard = {text: self._receivers.heard(text) & set(inhabited) for text in self._bus.intercepted}
        return sum(
            number
            for (key, segment), number in self._bus.flows().items()
            if any(where - {segment} and includes(text, key) for text, where in heard.items())
        )
