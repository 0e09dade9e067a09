"""Growth that is small in one trial, but comes with every message: it shows when the log is played several times."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from riot_bus.campaign.confirm import GAP_NS, join_logs, more_nominal, repeat
from riot_bus.campaign.triage import Failure, Types
from riot_bus.chain.unit.questions import FreshCases
from riot_bus.generalize.minimize import minimize
from riot_bus.inject.apply import inject_log
from riot_bus.statistics.rates import proportion
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Progress, Runner, TestCase, Violation

_MOST_TIMES, _MOST_MESSAGES = 64, 2000
"""Most repeats of a log, and most messages in all: if each repeat grows by 1/32 of what is allowed, all exceed it."""
_AIM = 4.0
"""Wanted growth as a share of what is allowed: it is clear, and much less than the usual limits."""
_ROUNDING = 1e-6
"""Seconds by which windows of time begin and end early, as sums of seconds are not exact."""


@dataclass(frozen=True, slots=True)
class Leak:
    """What repeats of a log have shown.

    Attributes:
        failure: Growth that only a log with injections causes; None if there is none.
        nominal: Failure that the nominal log causes, too, when it is repeated; then nothing is concluded.
    """

    failure: Failure | None = None
    nominal: Violation | None = None


def repeat_log(case: TestCase, times: int, *, registry: TypeRegistry) -> TestCase:
    """Return a case with its log several times, each time with the same injections."""
    log = case.messages
    seconds = (log[-1].time - log[0].time + GAP_NS) / 1e9
    counts = Counter(registry.topic(message.key) for message in log)

    def copies(each: Injection) -> Iterator[Injection]:
        if each.last is None and each.end is None:
            yield each  # it has no end, so it reaches all repeats
            return
        for number in range(times):
            places = number * counts[each.topic] if each.last is not None else 0
            moved = replace(each, first=each.first + places, last=None if each.last is None else each.last + places)
            if each.end is not None and number:
                later = number * seconds - _ROUNDING
                moved = replace(moved, start=each.start + later, end=min(each.end, seconds) + later)
            elif each.end is not None:
                moved = replace(moved, end=min(each.end, seconds - _ROUNDING))
            yield moved

    injections = tuple(one for each in case.injections for one in copies(each))
    return replace(case, messages=join_logs([log] * times), injections=injections)


def find_leak(
    grown: float,
    case: TestCase,
    runner: Runner,
    *,
    registry: TypeRegistry,
    types: Types,
    progress: Progress | None = None,
) -> Leak:
    """Play the log of a case several times to a process, with its injections and without; tell whether it leaks.

    Args:
        grown: Growth in the case beyond that of nominal trials, as a share of what is allowed.
    """
    times = min(_MOST_TIMES, _MOST_MESSAGES // len(case.messages), math.ceil(_AIM / grown))
    if times < 2:
        return Leak()
    long = repeat_log(case, times, registry=registry)
    (outcome,) = runner.run([long])
    violation = next((each for each in outcome.violations if each.monitor == "growth"), None)
    if violation is None:
        return Leak()
    signature = violation.signature
    played = len(inject_log(long.messages, long.injections, registry=registry, seed=long.seed)[0])
    controls = more_nominal(case, played, runner)
    for control in controls:
        if control.violations:
            return Leak(nominal=control.violations[0])
    if not all(control.judged for control in controls):
        return Leak()
    kept = _needed(case, times, signature, runner, registry=registry, progress=progress)
    long = repeat_log(replace(case, injections=kept), times, registry=registry)
    (outcome,) = runner.run([long])
    violation = next((each for each in outcome.violations if each.signature == signature), violation)
    rate = repeat(long, signature, runner)
    failure = Failure(violation, long, 0, outcome, len(long.injections), occurrences=1, rate=rate, types=types)
    failure.nominal = proportion(0, len(controls))
    failure.details.append(f"{violation.detail} (the log {times} times)")
    return Leak(failure if failure.confirmed else None)


def _needed(
    case: TestCase, times: int, signature: str, runner: Runner, *, registry: TypeRegistry, progress: Progress | None
) -> tuple[Injection, ...]:
    """Return the injections of a case that are needed for a leak; all if that was not found out."""
    fresh = FreshCases(runner)

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        parts = [tuple(case.injections[number] for number in kept) for kept in questions]
        cases = [repeat_log(replace(case, injections=part), times, registry=registry) for part in parts]
        return fresh.failures(cases, signature)

    try:
        found = minimize(len(case.injections), ask, budget=100, parallelism=runner.parallelism, progress=progress)
    except InconclusiveError:
        return case.injections
    return tuple(case.injections[number] for number in found.kept)
