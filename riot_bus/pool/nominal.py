"""Measurement of a unit's baseline in nominal trials, alone and in the whole system, before the unit is tested."""

from __future__ import annotations

import functools
import statistics
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.monitors.mined import Mined, check_rules, mine
from riot_bus.monitors.model import TrialView
from riot_bus.pool.wire import nominal_of
from riot_bus.processes.activity import Idle
from riot_bus.trial.baseline import Baseline, NominalTrial, baseline_of, probe_of
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.trial import TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.pool.local import Pool
    from riot_bus.system.system_file import RunPace
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Outcome

_MUCH_SLOWER = 2.0  # the order of the log costs no more than as much time again; as docs/riot-toml.md says of `order`
_TRIALS = 3
"""Number of nominal trials. What only some of them show, such as the output of a rare timer, is not expected."""
_HELD_OUT = 4
"""Held-out trials of each history for the false alarm rate of mined rules. If all eight are silent, the exact bound is
37 %; a bound of 1 % would take 368 trials, longer than most campaigns. A violation is repeated before it counts."""
_RUNS = _HELD_OUT
"""Number of nominal runs that are measured, and of further ones that are judged by the result."""
_KINDS = frozenset({"exit", "hang", "silent", "growth", "mined"})
"""Monitors that compare a unit with nominal trials."""


def measure_baseline(context: Context, unit: str, pool: Pool, log: Sequence[Message]) -> Baseline:
    """Measure the behaviour of a unit without input, and with its nominal log.

    If nominal trials fail, only the former is known.

    Raises:
        EnvironmentFaultError: The unit does not start.
        ConfigError: The unit hits one of its limits.
    """
    outcome = pool.execute(IdleTrial(unit), TestCase())
    if not outcome.judged:
        raise EnvironmentFaultError(outcome.detail)
    idle = _idle(outcome)
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
    rules = mine([[_probed(one, context, ()) for one in trials] for trials in (seen, half)])
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


def _idle(outcome: Outcome) -> Idle:
    """Return the activity of a unit without input, as a trial has measured it."""
    return Idle(float(outcome.statistics["switches"]), float(outcome.statistics["ran"]))


def _probed(trial: NominalTrial, context: Context, inputs: Sequence[Message]) -> TrialView:
    """Return a view of a nominal trial for rules: its outputs, and the inputs whose answers are judged."""
    return TrialView(
        [],
        settled=True,
        waited=0.0,
        registry=context.registry,
        outputs=trial.outputs,
        inputs=inputs,
        probed=trial.probed,
    )


def _keeps_order(context: Context, unit: str, pool: Pool, log: Sequence[Message], baseline: Baseline) -> bool:
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


def needs_baseline(monitor: str) -> bool:
    """Return whether a monitor can judge a unit only with its baseline."""
    return monitor in _KINDS


def measure_in_system(
    context: Context, unit: str, pool: Pool, alone: Baseline, pace: RunPace, driving: tuple[Message, ...]
) -> Baseline:
    """Measure the baseline of a unit in nominal runs of the whole system.

    Args:
        context: Context of the system.
        unit: Name of the unit.
        pool: Pool that executes the runs.
        alone: Baseline of the unit alone, whose probe is used here, too.
        pace: Duration and speed of external components.
        driving: Messages that are played to the system instead, if it has no external components.

    Raises:
        EnvironmentFaultError: The system does not start.
    """
    if not alone.trials:
        return Baseline(mute=alone.mute or ("it has no nominal trial of its own",))
    name = context.file.component_of(unit)
    own = [topic for topic in alone.log_answers if not context.others_publish(topic, name)]
    answers = {topic: alone.log_answers[topic] for topic in own}
    expected = {topic: count for topic, count in alone.probe_answers.items() if topic in answers}
    start = Baseline(probe=alone.probe, ordered=alone.ordered, log_answers=answers, probe_answers=expected)
    runs = pool.map(
        SystemTrial(pace, unit=unit, baseline=start, nominal=True),
        [TestCase(driving, seed=number) for number in range(_RUNS)],
    )
    if wrong := _not_passed(runs):
        return Baseline(mute=(wrong,))
    idle = functools.reduce(Idle.or_more, map(_idle, runs))
    found = in_system_of(alone, answers, [nominal_of(one) for one in runs], context=context, idle=idle)
    judged = pool.map(
        SystemTrial(pace, unit=unit, baseline=found),
        [TestCase(driving, seed=number) for number in range(_RUNS, 2 * _RUNS)],
    )
    if wrong := _not_passed([one for one in judged if not one.judged]):
        return Baseline(mute=(wrong,))
    alarms = {violation.signature for one in judged for violation in one.violations}
    return replace(found, alarms=tuple(sorted(alarms)))


def _not_passed(runs: Sequence[Outcome]) -> str:
    failed = [one for one in runs if one.verdict is not Verdict.PASS]
    if not failed:
        return ""
    return f"{len(failed)} of {len(runs)} nominal runs of the whole system did not pass: {_why(failed[0])}"


def in_system_of(
    alone: Baseline, answers: dict[str, int], runs: Sequence[NominalTrial], *, context: Context, idle: Idle
) -> Baseline:
    """Return what nominal runs of the whole system have in common.

    Args:
        alone: Baseline of the unit alone.
        answers: Outputs for the whole log in that, by topic, without topics on which other components publish, too.
        runs: Observations of the runs.
        context: Context of the system.
        idle: Activity of the unit before anything comes from outside.
    """
    found = baseline_of(runs, idle=idle, log=alone.log, ordered=alone.ordered)
    probed = {topic: count for topic, count in found.probe_answers.items() if topic in alone.probe_answers}
    views = [_probed(one, context, alone.probe) for one in runs if one.probed is not None]
    rules = tuple(rule for rule in alone.mined.rules if rule.topic in probed)
    mined = check_rules(rules, map(Mined(rules).judge, views), trials=alone.mined.trials)
    return replace(found, log_answers=answers, probe_answers=probed, mined=mined)


def why_not_told(baseline: Baseline, monitor: str, signature: str) -> str:
    """Return why a failure of a unit cannot be detected in runs of the whole system; empty if it can be.

    Args:
        baseline: Baseline of the unit in nominal runs of the whole system.
        monitor: Monitor that has found the failure in trials of the unit alone.
        signature: Signature of the failure.
    """
    if not baseline.trials:
        return baseline.mute[0] if baseline.mute else "nominal runs of the whole system are not known"
    if signature in baseline.alarms:
        return "nominal runs of the whole system show the same"
    place = signature.partition(": ")[2]
    if monitor == "exit":
        return _why_no_end(baseline, place)
    if monitor == "silent":
        topics = place.removeprefix("nothing on ").split(", ")
        if missing := [topic for topic in topics if topic not in baseline.log_answers]:
            return f"other components publish on {', '.join(missing)}, too"
        if not baseline.probe_answers.keys() & set(topics):
            return f"in nominal runs of the whole system the unit does not answer nominal input on {', '.join(topics)}"
    if monitor == "mined" and signature.removeprefix("mined ") not in map(str, baseline.mined.rules):
        return "the rule does not hold for the unit's answers in nominal runs of the whole system"
    if monitor == "hang" and place:
        usual = [name for name in place.removeprefix("in ").split(", ") if name in baseline.at_rest]
        return f"in nominal runs of the whole system threads stand in {', '.join(usual)}, too" if usual else ""
    return ""


def _why_no_end(baseline: Baseline, place: str) -> str:
    threads = place.removeprefix("a thread has ended: ")
    if threads != place:
        unknown = [name for name in threads.split(", ") if name not in baseline.threads]
        return f"nominal runs of the whole system have no thread of {', '.join(unknown)}" if unknown else ""
    if place.startswith("status 0"):
        return "the unit ends by itself in nominal runs of the whole system" if baseline.ends else ""
    return "its main thread ends in nominal runs of the whole system" if baseline.main_ends else ""
