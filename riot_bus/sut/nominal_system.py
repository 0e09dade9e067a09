"""Measurement of a unit's baseline in nominal runs of the whole system, before the unit is judged in other runs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.monitors.mined import Mined, check_rules
from riot_bus.monitors.model import TrialView
from riot_bus.sut.activity import STILL, Idle
from riot_bus.sut.baseline import Baseline, baseline_of
from riot_bus.sut.system_trial import SystemTrial
from riot_bus.sut.wire import nominal_of
from riot_bus.vocabulary.trial import TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.sut.baseline import NominalTrial
    from riot_bus.sut.context import Context
    from riot_bus.sut.local import Pool
    from riot_bus.sut.system import RunPace
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Outcome

__all__ = ["measure_in_system", "needs_baseline", "why_not_told"]

_RUNS = 4
"""Number of nominal runs that are measured, and of further ones that are judged by the result."""
_KINDS = frozenset({"exit", "hang", "silent", "growth", "mined"})
"""Monitors that compare a unit with nominal trials."""


def needs_baseline(monitor: str) -> bool:
    """Return whether a monitor can judge a unit only with its baseline."""
    return monitor in _KINDS


def measure_in_system(
    context: Context, unit: str, pool: Pool, alone: Baseline, pace: RunPace, driving: tuple[Message, ...]
) -> Baseline:
    """Measure the baseline of a unit in nominal runs of the whole system.

    Args:
        context: The system.
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
    found = in_system_of(alone, answers, [nominal_of(one) for one in runs], context=context, idle=_idle(runs))
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
    why = failed[0].violations[0].signature if failed[0].violations else failed[0].detail
    return f"{len(failed)} of {len(runs)} nominal runs of the whole system did not pass: {why}"


def _idle(runs: Sequence[Outcome]) -> Idle:
    idle = STILL
    for one in runs:
        idle = idle.or_more(Idle(float(one.statistics["switches"]), float(one.statistics["ran"])))
    return idle


def in_system_of(
    alone: Baseline,
    answers: dict[str, int],
    runs: Sequence[NominalTrial],
    *,
    context: Context,
    idle: Idle,
) -> Baseline:
    """Return what nominal runs of the whole system have in common.

    Args:
        alone: Baseline of the unit alone.
        answers: Outputs for the whole log in that, by topic, without topics on which other components publish, too.
        runs: Observations of the runs.
        context: The system.
        idle: Activity of the unit before anything comes from outside.
    """
    found = baseline_of(runs, idle=idle, log=alone.log, ordered=alone.ordered)
    probed = {topic: count for topic, count in found.probe_answers.items() if topic in alone.probe_answers}
    views = [
        TrialView(
            [],
            settled=True,
            waited=0.0,
            registry=context.registry,
            outputs=one.outputs,
            inputs=alone.probe,
            probed=one.probed,
        )
        for one in runs
        if one.probed is not None
    ]
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
