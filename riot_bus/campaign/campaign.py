"""A campaign of robustness tests on one unit: seeded, resumable, bounded by trials or time (RIOT II-A)."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.campaign.confirm import more_nominal, repeat_in_order
from riot_bus.campaign.covering import Covering, is_hang
from riot_bus.campaign.effects import Effects
from riot_bus.campaign.triage import Failure, group, plainer
from riot_bus.monitors.liveness import is_compared
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.campaign.novelty import Novelties
    from riot_bus.campaign.schedule import Schedule
    from riot_bus.campaign.stretches import Stretches
    from riot_bus.campaign.variations import Placed, Variation
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.message import Message

_ROUND = 8
"""Trials that are chosen together, so that one worker runs the same trials as eight."""
_DRAWN = 4
"""One in this many trials has policies on many messages; they are drawn blindly until each variation has been tried."""
_NARROWED = 2
"""One in this many trials after covering, apart from those with policies, isolates the cause of new behaviour."""
_NOMINAL = 4
_MORE_NOMINAL = 16
_MOST_CASES = 3
"""Cases of one signature that are repeated before it counts as unconfirmed."""
_HANGS, _HANG_SHARE = 8, 0.5
"""Hangs take more than this share of the time of all trials only until there have been so many; a guess."""


@dataclass(slots=True)
class CampaignResult:
    """Results of a campaign.

    Attributes:
        failures: Failures confirmed by fresh trials, by signature, in the order of discovery.
        unconfirmed: Failures that no fresh trial has shown again.
        trials: Number of all trials, without repeated ones.
        failing: Number of failing trials.
        exhausted: Whether the budget of trials was used up, or all was tried (False: time ran out, or the campaign was
            told to stop).
        notes: Notes and their numbers, such as of monitors that raised an exception or saw nothing.
        starts: Ways in which trials started the unit, and how many did so; the last trial's way at the end.
        tried: Variations that were tried, and whether they failed alone.
        undecided: Variations that failed together, and that the budget did not tell apart.
        coverable: Number of variations to try.
        effects: Effects of the injections.
        unjudged: Cases that could not be judged, and why.
        alarms: Signatures from comparison with nominal trials that nominal trials have shown themselves: no failures;
            also in `notes`.
        unordered: Number of passing trials in which the order across topics was given up.
        calm: Number of trials for which what had hung was kept back, since hangs took too much of the time.
        stopped: Whether it was told to stop.
        grown: Passing cases after which the unit had grown more than in nominal trials, the most first; before each
            how much more, as a share of what is allowed.
    """

    trials: int = 0
    failing: int = 0
    failures: dict[str, Failure] = field(default_factory=dict)
    exhausted: bool = False
    unconfirmed: dict[str, Failure] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)
    starts: dict[str, int] = field(default_factory=dict)
    tried: Sequence[tuple[Variation, bool]] = ()
    undecided: Sequence[Variation] = ()
    coverable: int = 0
    effects: Effects = field(default_factory=Effects)
    unjudged: list[tuple[TestCase, str]] = field(default_factory=list)
    alarms: Sequence[str] = ()
    unordered: int = 0
    calm: int = 0
    stopped: bool = False
    grown: list[tuple[float, TestCase]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Repeating:
    """A runner that reports when it has run trials."""

    runner: Runner
    tell: Callable[[str], None]

    @property
    def parallelism(self) -> int:
        return self.runner.parallelism

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        outcomes = self.runner.run(cases)
        self.tell(", repeating a failure")
        return outcomes


@dataclass(slots=True)
class _Campaign:
    runner: Runner
    found: Callable[[Failure], object]
    ordered: bool
    types: Mapping[tuple[str, str], str]
    result: CampaignResult = field(default_factory=CampaignResult)
    failures: dict[str, Failure] = field(default_factory=dict)
    alarms: dict[str, int] = field(default_factory=dict)
    baseless: dict[str, str] = field(default_factory=dict)
    nominal: list[Outcome] = field(default_factory=list)
    unseen: dict[str, dict[int, str]] = field(default_factory=dict)
    controlled: dict[str, int] = field(default_factory=dict)
    hangs: list[float] = field(default_factory=list)
    seconds: float = 0.0
    tell: Callable[[str], None] = lambda _: None

    @property
    def repeating(self) -> Runner:
        """Runner of further trials of cases that failed."""
        return _Repeating(self.runner, self.tell)

    def case(self, log: tuple[Message, ...], seed: int, injections: tuple[Injection, ...] = ()) -> TestCase:
        """Return a test case of this campaign."""
        return TestCase(log, injections, seed, ordered=self.ordered)

    @property
    def calm(self) -> bool:
        """Whether hangs have taken so much of the time of trials that the next ones should not hang."""
        return len(self.hangs) >= _HANGS and sum(self.hangs) > _HANG_SHARE * self.seconds

    def judge(self, cases: Mapping[int, TestCase], outcomes: Sequence[Outcome]) -> None:
        """Record the outcomes of some trials, and confirm new failures."""
        fresh, result = dict[str, Failure](), self.result
        for (trial, case), trial_outcome in zip(cases.items(), outcomes, strict=True):
            outcome = self._without_usual_growth(case, trial_outcome)
            if not outcome.judged:
                result.unjudged.append((case, outcome.detail))
                continue
            self.seconds += outcome.seconds
            self.hangs += [outcome.seconds] if is_hang(outcome) else []
            if started := str(outcome.statistics.get("started", "")):
                result.starts[started] = result.starts.pop(started, 0) + 1
            if outcome.detail:
                result.notes[outcome.detail] = result.notes.get(outcome.detail, 0) + 1
            result.unordered += bool(outcome.statistics.get("unordered")) and outcome.verdict is Verdict.PASS
            lines = map(str, outcome.statistics.get("unseen", ()))
            for name, reason in dict(line.partition(": ")[::2] for line in lines).items():
                self.unseen.setdefault(name, {}).setdefault(trial, reason)
            if case.injections:
                result.effects.add(case, outcome, self.nominal)
                if grown := outcome.statistics.get("grown"):
                    result.grown.append((float(grown), case))
            if outcome.verdict is Verdict.FAIL:
                result.failing += 1
                fresh |= {
                    each.violation.signature: each
                    for each in group(self.failures, case, outcome, trial=trial, types=self.types)
                }
        for failure in [each for each in fresh.values() if not each.confirmed]:
            self.confirm(failure)
            if failure.confirmed:
                self.found(failure)

    def confirm(self, failure: Failure) -> None:
        """Repeat a failure with fresh trials, unless its cases, or this one, have been repeated often enough."""
        if failure.attempts >= _MOST_CASES or failure.trial in failure.tried:
            return
        failure.attempts += 1
        failure.tried.add(failure.trial)
        signature = failure.violation.signature
        failure.nominal = proportion(sum(one.failed_as(signature) for one in self.nominal), len(self.nominal))
        failure.case, failure.rate = repeat_in_order(failure.case, signature, self.repeating)
        if not failure.rate.total:
            self.result.notes[f"{signature}: none of its repeats could be judged"] = failure.attempts

    def simplify(self, failure: Failure) -> None:
        """Make the simplest case that fails as often represent a failure, without injections that it does not need."""
        if failure.simpler is not None:
            self._replace(failure, *failure.simpler)
            failure.simpler = None
        for case in plainer(failure):
            (outcome,) = self.repeating.run([case])
            if outcome.failed_as(failure.violation.signature) and self._replace(failure, case, failure.trial, outcome):
                break

    def _replace(self, failure: Failure, case: TestCase, trial: int, outcome: Outcome) -> bool:
        """Make another case represent a failure if it fails as often; return whether it does."""
        case, rate = repeat_in_order(case, failure.violation.signature, self.repeating)
        as_often = failure.rate is None or rate.rate >= failure.rate.rate
        if as_often:
            failure.represent_by(case, trial, outcome)
            failure.rate = rate
        return as_often

    def check_nominal(self, log: tuple[Message, ...], seed: int) -> int:
        """Run the nominal log, more often if verdicts differ; return the number of trials."""
        cases, outcomes = dict[int, TestCase](), list[Outcome]()
        for count in (_NOMINAL, _MORE_NOMINAL):
            if not outcomes or len({outcome.verdict for outcome in outcomes}) > 1:
                more = {-number: self.case(log, seed + number - 1) for number in range(len(cases) + 1, count + 1)}
                outcomes += _run_nominal(self.runner, list(more.values()))
                cases |= more
        self._know_alarms(outcomes)
        told = [dict(outcome.statistics.get("baseless", {})) for outcome in outcomes]
        self.baseless = {key: why for key, why in told[0].items() if all(key in each for each in told)}
        outcomes = list(map(self._judged, outcomes))
        self.nominal = outcomes
        self.judge(cases, outcomes)
        return len(outcomes)

    def explore(self, cases: Mapping[int, TestCase]) -> Sequence[Outcome]:
        """Run injected trials."""
        return list(map(self._judged, self.runner.run(list(cases.values()))))

    def _know_alarms(self, outcomes: Sequence[Outcome]) -> None:
        """Note violations by comparison with nominal trials that nominal trials show themselves: they are nominal."""
        for outcome in outcomes:
            for signature in {each.signature for each in outcome.violations if is_compared(each)}:
                self.alarms[signature] = self.alarms.get(signature, 0) + 1

    def _without_usual_growth(self, case: TestCase, outcome: Outcome) -> Outcome:
        """Return an outcome without growth that more nominal messages cause, too."""
        played = int(outcome.statistics.get("played", 0))
        for signature in {each.signature for each in outcome.violations if each.monitor == "growth"} - set(self.alarms):
            if played > max(2 * len(case.messages), self.controlled.get(signature, 0)):
                self.controlled[signature] = played
                controls = more_nominal(case, played, self.repeating)
                if usual := sum(one.failed_as(signature) for one in controls):
                    self.alarms[signature] = usual
        return self._judged(outcome)

    def _judged(self, outcome: Outcome) -> Outcome:
        """Return an outcome without violations that say nothing about the unit."""
        if not self.alarms and not self.baseless:
            return outcome
        return outcome.without(lambda each: each.signature in self.alarms or each.signature in self.baseless)


def _run_nominal(runner: Runner, cases: Sequence[TestCase]) -> list[Outcome]:
    """Run trials of the nominal log; if these cannot be judged, no others can."""
    outcomes = list(runner.run(cases))
    for outcome in outcomes:
        if not outcome.judged:
            raise EnvironmentFaultError(f"a trial of the nominal log could not be carried out: {outcome.detail}")
    return outcomes


def run_campaign(
    messages: Sequence[Message],
    schedule: Schedule,
    runner: Runner,
    *,
    seed: int,
    trials: int | None,
    covering: Covering | None = None,
    ordered: bool = False,
    seconds: float | None = None,
    covered: bool = False,
    progress: Callable[[int, int | None, str, float | None], object] | None = None,
    found: Callable[[Failure], object] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> CampaignResult:
    """Run trials until the budget ends; each failure is repeated with fresh processes before it counts.

    A unit that always fails on the nominal log is not tested further. One that sometimes fails is tested: its failures
    on the nominal log are findings without injections, with their rates.

    Args:
        messages: The nominal log of the unit's inputs.
        schedule: Schedule that draws the injections of the other trials.
        runner: Runner of test cases.
        seed: Seed of the campaign.
        trials: Largest number of injected trials, not counting nominal and repeated ones; None for no limit.
        covering: Covering that chooses most trials; without it, all are drawn.
        ordered: Whether trials keep the order of the log across topics.
        seconds: Time limit in seconds; None for no limit.
        covered: Whether to end when all that `covering` has to try was tried.
        progress: Function that is called after each batch, also those that repeat failures, with the injected trials so
            far, their final number (None if unknown), a text on the state, and the seconds left (None for no limit).
        found: Function that is called with each failure as soon as it is confirmed.
        stop: Function that is called before each batch of injected trials; True ends the campaign.

    Raises:
        EnvironmentFaultError: Trials of the nominal log cannot be judged.
    """
    log, stopped = tuple(messages), False
    work = _Campaign(runner, found, ordered, schedule.types)
    nominal = work.check_nominal(log, seed)
    result = work.result
    done, started, most = 0, time.monotonic(), sys.maxsize if trials is None else trials
    hopeless = result.failing == nominal
    if covering:
        covering.nominal_outputs = min(int(one.statistics.get("outputs", 0)) for one in work.nominal)

    def tell(doing: str = "") -> None:
        if progress:
            distinct = sum(failure.confirmed for failure in work.failures.values())
            told = f", {covering.covered} of {covering.total} tried" if covering else ""
            left = None if seconds is None else max(0.0, started + seconds - time.monotonic())
            total = None if covered and covering else trials  # covering ends before that
            progress(done, total, f"{result.failing} failing, {distinct} distinct{told}{doing}", left)

    work.tell = tell
    while not hopeless and done < most and (seconds is None or time.monotonic() - started < seconds):
        if stopped := stop():
            break
        if covered and covering and covering.finished:
            break
        batch = range(done, min(most, done + max(_ROUND, runner.parallelism)))
        calm = work.calm and not covered
        result.calm += len(batch) if calm and covering else 0
        together = {trial: _together(covering, trial, calm=calm) for trial in batch}
        cases = {
            trial: work.case(log, seed, tuple(one for placed in chosen for one in placed.injections))
            if chosen
            else work.case(log, seed, schedule.injections(trial))
            for trial, (_, chosen) in together.items()
        }
        outcomes = work.explore(cases)
        if covering and not done:
            covering.novelties.know(work.nominal)
        done = batch.stop
        work.judge(cases, outcomes)
        for (chooser, chosen), outcome in zip(together.values(), outcomes, strict=True):
            if chooser and chosen:
                chooser.record(chosen, outcome)
        tell()
    for failure in work.failures.values():
        (result.failures if failure.confirmed else result.unconfirmed)[failure.violation.signature] = failure
    for failure in result.failures.values():
        work.simplify(failure)
    every = nominal + done - len(result.unjudged)
    blind = {name: next(reversed(each.values())) for name, each in work.unseen.items() if len(each) == every}
    result.notes |= {f"{name}: {why}": every for name, why in blind.items()}
    result.notes |= {f"{signature}: {why}, in no nominal trial": nominal for signature, why in work.baseless.items()}
    result.notes |= {f"{signature}: nominal trials show the same": count for signature, count in work.alarms.items()}
    if covering:
        result.tried, result.undecided, result.coverable = covering.tried, covering.undecided, covering.total
    result.trials, result.stopped, result.alarms = nominal + done, stopped, sorted(work.alarms)
    result.exhausted = not hopeless and (done >= most or (covered and covering is not None and covering.finished))
    result.grown.sort(key=lambda each: -each[0])
    return result


def _together(
    covering: Covering | None, trial: int, *, calm: bool
) -> tuple[Covering | Stretches | Novelties | None, tuple[Placed, ...]]:
    """Return the variations that a trial tries together, and their chooser; nothing if its injections are drawn."""
    if covering is None:
        return None, ()
    if not (trial + 1) % _DRAWN:
        policies = covering.policies()
        if policies or not calm:
            return covering.stretches, policies
    if covering.finished and not trial % _NARROWED and (part := covering.novelties.next()):
        return covering.novelties, part
    return covering, covering.next(calm=calm) or covering.further()
