"""The two segments of the router of `riot ros-test`: placement of processes, connected components, and crossings.

Only a message with a subscriber in another segment passes the router: within one segment, messages bypass riot.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from riot_bus.control.segment_environment import export, segment_variables, write_session_files
from riot_bus.processes.ros_domains import free_domains
from riot_bus.router.receivers import Receivers
from riot_bus.zenoh.session import environment_of_others, includes
from riot_bus_bridges.ros_test.bridged_domains import bridged_domains
from riot_bus_bridges.ros_test.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from riot_bus.control.router_service import RouterService
    from riot_bus.processes.launcher import Launcher
    from riot_bus.router.bus import Bus

HERE, UNIT = "system", "unit"
"""The segment of the command, and that of the chosen processes."""


@dataclass(frozen=True, slots=True)
class ReadySegments:
    """Segments that are ready for a command.

    Attributes:
        environment: Whole environment of the command.
        placement: Placement of processes into the other segment.
        domains: ROS domain of each segment; empty without bridges.
        carried: Number of messages that bridges have carried into a domain, by topic; known at the end.
    """

    environment: Mapping[str, str]
    placement: Placement
    domains: Mapping[str, int]
    carried: Mapping[str, int]


@contextmanager
def open_segments(
    service: RouterService, launcher: Launcher, folder: Path, *, nodes: str | None, dds: bool
) -> Iterator[ReadySegments]:
    """Make the segments of a running router ready for a command.

    Args:
        service: The running router.
        launcher: Owner of the bridges' processes.
        folder: Folder for files; only this user should be able to write there.
        nodes: Regular expression for the processes to put into the segment `unit`; None for none.
        dds: Whether nodes use DDS.

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
