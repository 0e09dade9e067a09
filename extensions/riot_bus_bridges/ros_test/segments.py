"""The two segments of the router of `riot ros-test`: placement of processes, connected components, and crossings.

Only a message with a subscriber in another segment passes the router: within one segment, messages bypass riot.
"""

from __future__ import annotations

import json
import os
import re
import signal
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.log_paths import file_stem
from riot_bus.control.segment_environment import export, segment_variables, write_session_files
from riot_bus.processes.placement import StartedProcesses, hooked, started_in
from riot_bus.processes.ros_domains import free_domains, riot_command, start_bridge
from riot_bus.router.receivers import Receivers
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.zenoh.session import environment_of_others, includes, wait_until
from riot_bus_bridges.ros2.node import START_S

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from riot_bus.control.router_service import RouterService
    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.router.bus import Bus

_LARGEST = 1 << 20  # letters; a report has a few lines (`Passage.lines`), so a longer text is not a report


def is_colcon_test(command: Sequence[str]) -> bool:
    """Return whether a command is `colcon test`, which runs the tests of many packages."""
    names = [os.path.basename(word) for word in command]
    return "colcon" in names[:3] and "test" in names[names.index("colcon") :]


def router_per_package(
    given: Mapping[str, str], options: Sequence[str], *, folder: Path, accounts: Path
) -> dict[str, str]:
    """Return the variables that make colcon run the tests of each package under a `riot ros-test` of its own."""
    plan = folder / "packages.json"
    own = ["--package", "{package}", "--in", "{folder}", "--account", str(accounts), "--"]
    wrap = [*riot_command(), "ros-test", *options, *own]
    plan.write_text(json.dumps({"wrap": wrap, "cwd": str(Path.cwd()), "hook": str(HOOK)}), encoding="utf-8")
    return hooked(given, plan)


def leave_account(folder: Path, package: str, lines: Sequence[str], *, vacuous: bool) -> None:
    """Write a report into a folder."""
    text = json.dumps({"package": package, "lines": list(lines), "vacuous": vacuous})
    (folder / f"{file_stem(package)}-{os.getpid()}.json").write_text(text, encoding="utf-8")


def package_lines(folder: Path) -> list[str]:
    """Return the lines for all packages, and a summary that stresses the packages that have shown nothing."""
    found: list[dict[str, Any]] = []
    for path in sorted(folder.glob("*.json")):
        with path.open(encoding="utf-8") as stream:
            found.append(json.loads(stream.read(_LARGEST)))
    if not found:
        return ["NO TESTS OF A PACKAGE WENT THROUGH A ROUTER: colcon has started none by ctest, pytest or unittest"]
    vacuous = [each["package"] for each in found if each["vacuous"]]
    lines = [f"{each['package']}: {line}" for each in found for line in each["lines"]]
    told = f"; NOTHING SHOWN by {', '.join(vacuous)}" if vacuous else ""
    lines.append(f"tests of {counted(len(found), 'package')}, each through a router of its own{told}")
    return [escape_control_chars(line) for line in lines]


HOOK = Path(__file__).with_name("hook.py")
"""File that a plan names, so that the core's hook loads it."""


class Placement:
    """Puts processes into a segment by their names.

    Args:
        folder: Folder for two files; only this user should be able to write there.

    Raises:
        ConfigError: `nodes` is not a regular expression.
    """

    def __init__(self, folder: Path, *, segment: str, nodes: str | None, variables: Mapping[str, str]) -> None:
        try:
            re.compile(nodes or "")
        except re.error as error:
            hint = "such as 'planner|/robot1/controller'"
            text = f"{nodes!r} is not a regular expression: {error}"
            raise ConfigError(text, where="--unit-nodes", hint=hint) from None
        self._plan, self._told = folder / "placement.json", folder / "started.jsonl"
        self._told.touch(0o600)
        plan = {"segment": segment, "nodes": nodes or "", "variables": dict(variables), "told": str(self._told)}
        plan["hook"] = str(HOOK)
        self._plan.write_text(json.dumps(plan), encoding="utf-8")

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """Return the variables that activate the hook in a process with the given variables."""
        return hooked(given, self._plan)

    def started(self) -> StartedProcesses:
        """Return what was started so far."""
        return started_in(self._told)


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
        launcher.wait(bridges, timeout=15.0)  # 5 s for its last messages, and 10 s for its node
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
    """Make a running router's segments ready for a command; raises EnvironmentFaultError if a bridge does not start."""
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
