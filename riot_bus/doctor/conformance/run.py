"""Runs scenarios in several ways and compares what their ends saw."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.conductor import EndFailedError, conduct
from riot_bus.doctor.conformance.network import BusNetwork, PlainNetwork, RunningNetwork
from riot_bus.doctor.conformance.security import settings_for
from riot_bus.vocabulary.errors import RiotError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from riot_bus.doctor.conformance.network import ScenarioNetwork
    from riot_bus.doctor.conformance.scenario import Need, Scenario
    from riot_bus.doctor.conformance.security import Settings

__all__ = ["OURS", "PLAIN", "Difference", "ScenarioResult", "WayOutcome", "compare", "run_scenario", "run_suite"]

PLAIN = "plain"
OURS = (PLAIN, "native", "junction", "intercepted")
"""The ways whose routers we start ourselves.

Messages that are not intercepted go directly from segment to segment (`native`) until another set of keys is
intercepted, and over the junction from then on.
"""

_OWN_ROUTER: frozenset[Need] = frozenset({"router", "tls", "mtls", "password", "shm"})
_TIMEOUT_S = 40.0  # waits for messages take at most 10 s each; ends that need more hang


@dataclass(frozen=True)
class WayOutcome:
    """What happened in one way.

    Attributes:
        way: One of `OURS`, or the name of a running router.
        observations: What each end saw.
        error: Why there are no observations.
        skipped: Why it was not tried.
        losses: What the network itself says about losses.
        seconds: How long it took.
    """

    way: str
    observations: Mapping[str, Any] = field(default_factory=dict)
    error: str | None = None
    skipped: str | None = None
    losses: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class Difference:
    """One place where a way differs from the plain router."""

    way: str
    place: str
    plain: Any
    seen: Any

    def __str__(self) -> str:
        return f"{self.way}: {self.place or 'outcome'}: {self.seen!r} instead of {self.plain!r}"


@dataclass(frozen=True)
class ScenarioResult:
    """What one scenario showed."""

    scenario: Scenario
    outcomes: tuple[WayOutcome, ...]
    differences: tuple[Difference, ...]

    @property
    def unexpected(self) -> list[Difference]:
        """Differences that are not documented."""
        return [each for each in self.differences if each.way not in self.scenario.limits]

    @property
    def outdated(self) -> list[str]:
        """Ways whose documented difference is gone."""
        tried = {each.way for each in self.outcomes if not each.skipped}
        return [way for way in self.scenario.limits if way in tried - {each.way for each in self.differences}]


class Absent:
    """Placeholder for a missing value."""

    def __repr__(self) -> str:
        return "nothing"


_ABSENT = Absent()


def run_scenario(
    scenario: Scenario,
    way: str,
    endpoints: tuple[str, str] | None = None,
    *,
    folder: Path | None = None,
    timeout: float = _TIMEOUT_S,
) -> WayOutcome:
    """Run a scenario in one way.

    Args:
        scenario: The scenario that both ends play.
        way: One of `OURS`, or any name together with `endpoints`.
        endpoints: Endpoints of a router that is already running, for the left and the right end.
        folder: Where certificates are kept from one run to the next; by default a temporary folder.
        timeout: Seconds within which both ends must be done.
    """
    if endpoints is not None and (missing := scenario.needs & _OWN_ROUTER):
        return WayOutcome(way, skipped=f"needs a router of our own: {', '.join(sorted(missing))}")
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="riot-transparency-") as temporary:
        try:
            settings = settings_for(scenario.needs, folder or Path(temporary))
        except RiotError as error:
            return WayOutcome(way, skipped=error.message)
        try:
            with _network(scenario, way, endpoints, settings) as network:
                seen = conduct(scenario, network, config=settings.end, timeout=timeout)
                losses = tuple(network.report())
        except (EndFailedError, RiotError) as error:
            return WayOutcome(way, error=str(error), seconds=time.monotonic() - began)
    return WayOutcome(way, seen, losses=losses, seconds=time.monotonic() - began)


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


def run_suite(
    scenarios: Iterable[Scenario],
    ways: Mapping[str, tuple[str, str] | None] | None = None,
    *,
    say: Callable[[ScenarioResult], None] = lambda result: None,
) -> list[ScenarioResult]:
    """Run scenarios in several ways, the plain router first.

    Args:
        scenarios: Scenarios, in the order in which they are run.
        ways: Ways, with endpoints if their router is already running, else None; by default `OURS`.
        say: Called with each result.
    """
    chosen = {PLAIN: None, **(ways if ways is not None else dict.fromkeys(OURS))}
    results = []
    with tempfile.TemporaryDirectory(prefix="riot-transparency-") as folder:
        for scenario in scenarios:
            outcomes = tuple(run_scenario(scenario, way, at, folder=Path(folder)) for way, at in chosen.items())
            results.append(ScenarioResult(scenario, outcomes, tuple(compare(outcomes))))
            say(results[-1])
    return results
