"""Measurement of a unit's baseline in nominal trials, before the unit is tested."""

from __future__ import annotations

import statistics
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.monitors.mined import Mined, check_rules, mine
from riot_bus.monitors.model import TrialView
from riot_bus.sut.activity import Idle
from riot_bus.sut.baseline import Baseline, NominalTrial, baseline_of, probe_of
from riot_bus.sut.unit_trial import IdleTrial, UnitTrial
from riot_bus.sut.wire import nominal_of
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.trial import TestCase

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.sut.context import Context
    from riot_bus.sut.local import Pool
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Outcome

__all__ = ["measure_baseline"]

_MUCH_SLOWER = 2.0
_TRIALS = 3
"""Number of nominal trials. What only some of them show, such as the output of a rare timer, is not expected."""
_HELD_OUT = 4
"""Held-out trials of each history for the false alarm rate of mined rules. If all eight are silent, the exact bound is
37 %; a bound of 1 % would take 368 trials, longer than most campaigns. A violation is repeated before it counts."""


def measure_baseline(
    context: Context,
    unit: str,
    pool: Pool,
    log: Sequence[Message],
) -> Baseline:
    """Measure the behaviour of a unit without input, and with its nominal log.

    If nominal trials fail, only the former is known.

    Args:
        context: The system.
        unit: Name of the unit.
        pool: Pool that executes the trials.
        log: Nominal log of the unit.

    Raises:
        EnvironmentFaultError: The unit does not start.
        ConfigError: The unit hits one of its limits.
    """
    outcome = pool.execute(IdleTrial(unit), TestCase())
    if not outcome.judged:
        raise EnvironmentFaultError(outcome.detail)
    idle = Idle(float(outcome.statistics["switches"]), float(outcome.statistics["ran"]))
    if not log:
        return Baseline(idle=idle)
    ordered = _keeps_order(context, unit, pool, log, Baseline(idle=idle))
    start = Baseline(idle=idle, probe=probe_of(log))

    wrong: list[str] = []
    busy: list[float] = []

    def nominal(history: Sequence[Message], count: int, known: Mapping[str, int]) -> list[NominalTrial]:
        """Return the observations of nominal trials; if one fails, return nothing and add the reason to `wrong`."""
        trial = UnitTrial(unit, replace(start, probe_answers=known), nominal=True)
        cases = [TestCase(tuple(history), seed=number, ordered=ordered) for number in range(count)]
        outcomes = pool.map(trial, cases)
        _check_starts(outcomes)
        busy.extend(float(one.statistics.get("busy", 0.0)) for one in outcomes)
        for each in (violation for one in outcomes for violation in one.violations if violation.monitor == "limit"):
            raise ConfigError(
                f"unit {unit!r} hits a limit in a nominal trial: {each.detail}",
                where=str(context.file.path),
                hint=f'write [components.{each.component}] limits = {{ ... }} with more than that, or "off"',
            )
        failed = [one for one in outcomes if not _passes(one)]
        if failed:
            alone = pool.map(UnitTrial(unit, Baseline(idle=idle)), cases) if start.probe else []
            log_passes = bool(alone) and all(map(_passes, alone))
            probe = f", then {len(start.probe)} of them again as a probe," if log_passes else ""
            wrong.append(
                f"{len(failed)} of {count} trials with {len(history)} nominal messages{probe} did not pass: "
                f"{_why(failed[0])}{'; without the probe, all passed' if log_passes else ''}"
            )
        return [] if failed else [nominal_of(one) for one in outcomes]

    seen = nominal(log, _TRIALS, {})
    found = replace(baseline_of(seen, idle=idle, log=log, ordered=ordered), busy=statistics.median(busy))
    if not seen:
        return replace(found, mute=(f"exit, silent, growth and mined: {wrong[0]}",))
    if not context.file.unit[unit].mined or not found.probe_answers:
        return found
    stretch = log[: len(log) // 2]
    half = nominal(stretch, _TRIALS, found.probe_answers)
    if not half:
        return replace(found, mute=(*found.mute, f"mined: {wrong[0]}"))
    rules = mine([[_probed(one, context) for one in trials] for trials in (seen, half)])
    mined = Mined(rules, 2 * _TRIALS)
    others = pool.map(
        UnitTrial(unit, replace(found, mined=mined)),
        [
            TestCase(tuple(history), seed=_TRIALS + number, ordered=ordered)
            for history in (log, stretch)
            for number in range(_HELD_OUT)
        ],
    )
    if failed := [one for one in others if not _passes(one, but="mined")]:
        told = f"mined: {len(failed)} of {len(others)} other nominal trials did not pass: {_why(failed[0])}"
        return replace(found, mute=(*found.mute, told))
    return replace(found, mined=check_rules(rules, [one.violations for one in others], trials=mined.trials))


def _check_starts(outcomes: Sequence[Outcome]) -> None:
    """Raise if no trial could be carried out, as if a unit is never ready; then no other one can."""
    if not any(outcome.judged for outcome in outcomes):
        raise EnvironmentFaultError(outcomes[0].detail)


def _passes(outcome: Outcome, *, but: str = "") -> bool:
    """Return whether a trial was judged, and no monitor found a failure, except for the monitor `but`."""
    return outcome.judged and all(each.monitor == but for each in outcome.violations)


def _why(outcome: Outcome) -> str:
    return outcome.violations[0].signature if outcome.violations else outcome.detail


def _probed(trial: NominalTrial, context: Context) -> TrialView:
    """Return what rules are mined from."""
    return TrialView(
        [],
        settled=True,
        waited=0.0,
        registry=context.registry,
        outputs=trial.outputs,
        probed=trial.probed,
    )


def _keeps_order(
    context: Context,
    unit: str,
    pool: Pool,
    log: Sequence[Message],
    baseline: Baseline,
) -> bool:
    """Return whether trials keep the order across topics: as riot.toml says, with "auto" if it is not much slower."""
    asked = context.file.unit[unit].order
    if asked != "auto" or len({message.key for message in log}) < 2:
        return asked == "log"
    trial = UnitTrial(unit, baseline)
    case = TestCase(tuple(log))
    ways = (False, True, False, True)  # in parallel, if there are enough processors
    outcomes = pool.map(trial, [replace(case, ordered=way) for way in ways])
    _check_starts(outcomes)
    kept, free = ([one.seconds for one in outcomes[first::2] if _passes(one)] for first in (1, 0))
    return not kept or not free or min(kept) <= _MUCH_SLOWER * min(free)  # times of failed trials do not count
