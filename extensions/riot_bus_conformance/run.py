"""Runs scenarios in several ways and compares what their ends saw."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import RiotError
from riot_bus_conformance.conductor import EndFailedError, conduct
from riot_bus_conformance.network import BusNetwork, PlainNetwork, RunningNetwork
from riot_bus_conformance.security import settings_for

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from riot_bus_conformance.network import ScenarioNetwork
    from riot_bus_conformance.scenario import Need, Scenario
    from riot_bus_conformance.security import Settings

PLAIN = "plain"
OURS = (PLAIN, "native", "junction", "intercepted")
"""The ways whose routers we start ourselves.

Messages that are not intercepted go directly from segment to segment (`native`) until another set of keys is
intercepted, and over the junction from then on.
"""

_OWN_ROUTER: frozenset[Need] = frozenset({"router", "tls", "mtls", "password", "shm"})


@dataclass(frozen=True)
class WayOutcome:
    """Result of a scenario in one way."""

    way: str
    observations: Mapping[str, Any] = field(default_factory=dict)
    error: str | None = None
    skipped: str | None = None
    losses: tuple[str, ...] = ()


@dataclass(frozen=True)
class Difference:
    """One place where a way differs from the plain router."""

    way: str
    place: str
    plain: Any
    seen: Any

    def __str__(self) -> str:
        return f"{self.way}: {self.place or 'outcome'}: {self.seen!r} instead of {self.plain!r}"


class _Absent:
    """Placeholder for a missing value."""

    def __repr__(self) -> str:
        return "nothing"


_ABSENT = _Absent()


def run_scenario(
    scenario: Scenario,
    way: str,
    endpoints: tuple[str, str] | None = None,
    *,
    folder: Path | None = None,
) -> WayOutcome:
    """Run a scenario in one way.

    Args:
        way: One of `OURS`, or any name together with `endpoints`.
        endpoints: Endpoints of a router that is already running, for the left and the right end.
        folder: Folder in which certificates are kept from one run to the next; by default a temporary folder.
    """
    if endpoints is not None and (missing := scenario.needs & _OWN_ROUTER):
        return WayOutcome(way, skipped=f"needs a router of our own: {', '.join(sorted(missing))}")
    with tempfile.TemporaryDirectory(prefix="riot-transparency-") as temporary:
        try:
            settings = settings_for(scenario.needs, folder or Path(temporary))
        except RiotError as error:
            return WayOutcome(way, skipped=error.message)
        try:
            with _network(scenario, way, endpoints, settings) as network:
                # Waits for messages take at most 10 s each: ends that need more than the timeout hang.
                seen = conduct(scenario, network, config=settings.end, timeout=40.0)
                losses = tuple(network.report())
        except (EndFailedError, RiotError) as error:
            return WayOutcome(way, error=str(error))
    return WayOutcome(way, seen, losses=losses)


def _network(scenario: Scenario, way: str, endpoints: tuple[str, str] | None, settings: Settings) -> ScenarioNetwork:
    if endpoints is not None:
        return RunningNetwork(*endpoints)
    if way == PLAIN:
        return PlainNetwork(settings)
    if way not in OURS:
        raise ValueError(f"way {way!r} needs endpoints")
    return BusNetwork(settings, scenario.keys if way == "intercepted" else (), changed=way == "junction")


def compare(outcomes: Sequence[WayOutcome]) -> list[Difference]:
    """Compare every outcome with the first one."""
    tried = [outcome for outcome in outcomes if outcome.skipped is None]
    if not tried:
        return []
    plain, *others = tried
    if plain.error is not None:
        return [Difference(plain.way, "", "an observation", plain.error)]
    differences = []
    for other in others:
        if other.error is not None:
            differences.append(Difference(other.way, "", "an observation", other.error))
        else:
            found = _differences("", plain.observations, other.observations)
            differences += [Difference(other.way, *each) for each in found]
        differences += [Difference(other.way, "losses", "none", loss) for loss in other.losses]
    return differences


def _differences(place: str, plain: Any, seen: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(plain, dict) and isinstance(seen, dict):
        for key in plain | seen:
            yield from _differences(f"{place}.{key}".lstrip("."), plain.get(key, _ABSENT), seen.get(key, _ABSENT))
    elif isinstance(plain, list) and isinstance(seen, list) and len(plain) == len(seen):
        for index, (one, other) in enumerate(zip(plain, seen, strict=True)):
            yield from _differences(f"{place}[{index}]", one, other)
    elif plain != seen:
        yield place, plain, seen
