"""A campaign of robustness tests on one unit: seeded, resumable, bounded by trials or time (RIOT II-A)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from riot_bus.campaign.confirm import more_nominal, repeat_in_order
from riot_bus.campaign.covering import Covering, is_hang
from riot_bus.campaign.effects import Effects
from riot_bus.campaign.schedule import Schedule
from riot_bus.campaign.stretches import Stretches
from riot_bus.campaign.triage import Failure, group, plainer
from riot_bus.campaign.variations import Placed, Variation
from riot_bus.monitors.liveness import is_compared
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict

_ROUND = 8
"""Trials that are chosen together, so that one worker runs the same trials as eight."""
_DRAWN = 4
"""One in this many trials has policies on many messages; they are drawn blindly until each variation has been tried."""
_MOST_CASES = 3
"""Cases of one signature that are repeated before it counts as unconfirmed."""
_HANGS, _HANG_SHARE = 8, 0.5
"""Hangs take more than this share of the time of all trials only until there have been so many; a guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSettings:
    """Seed and budget of a campaign.

    Attributes:
        trials: Largest number of injected trials, not counting nominal and repeated ones; None for no limit.
        seconds: Time limit in seconds; None for no limit.
        covered: Whether to end when all that the covering has to try was tried.
        ordered: Whether trials keep the order of the log across topics.
    """

    seed: int
    trials: int | None
    seconds: float | None = None
    covered: bool = False
    ordered: bool = False


@dataclass(slots=True)
class CampaignResult:
    """Results of a campaign.

    Attributes:
        failures: Failures confirmed by fresh trials, by signature, in the order of discovery.
        trials: Number of all trials, without repeated ones.
        exhausted: Whether the budget of trials was used up, or all was tried (False: time ran out, or the campaign was
            told to stop).
        notes: Notes and their numbers, such as of monitors that raised an exception or saw nothing.
        starts: Ways in which trials started the unit, and how many did so; the last trial's way at the end.
        tried: Variations that were tried, and whether they failed alone.
        undecided: Variations that failed together, and that the budget did not tell apart.
        unjudged: Cases that could not be judged, and why.
        alarms: Signatures from comparison with nominal trials that nominal trials have shown themselves: no failures;
            also in `notes`.
        unordered: Number of passing trials in which the order across topics was given up.
        calm: Number of trials for which what had hung was kept back, since hangs took too much of the time.
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


@dataclass(slots=True)
class _Campaign:
    """A campaign while it runs.

    Attributes:
        done: Number of injected trials so far.
        alarms: Number of nominal trials that show a signature.
        baseless: Signatures that no nominal trial could be compared for, and why.
        unseen: By monitor, the trials in which it saw nothing, and why.
        controlled: By signature of growth, how many messages its last control has played.
        hangs: Seconds of each trial that hung.
        seconds: Seconds of all trials together.
    """

    log: tuple[Message, ...]
    schedule: Schedule
    runner: Runner
    settings: CampaignSettings
    covering: Covering | None
    progress: Callable[[int, int | None, str, float | None], object] | None
    found: Callable[[Failure], object]
    started: float = field(default_factory=time.monotonic)
    result: CampaignResult = field(default_factory=CampaignResult)
    done: int = 0
    failures: dict[str, Failure] = field(default_factory=dict)
    alarms: dict[str, int] = field(default_factory=dict)
    baseless: dict[str, str] = field(default_factory=dict)
    nominal: list[Outcome] = field(default_factory=list)
    unseen: dict[str, dict[int, str]] = field(default_factory=dict)
    controlled: dict[str, int] = field(default_factory=dict)
    hangs: list[float] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def all_tried(self) -> bool:
        """Whether the campaign ends because the covering has nothing left to try."""
        return self.settings.covered and self.covering is not None and self.covering.finished

    @property
    def used_up(self) -> bool:
        """Whether the budget of trials was used up, or all was tried."""
        return self.all_tried or (self.settings.trials is not None and self.done >= self.settings.trials)

    @property
    def time_is_over(self) -> bool:
        """Whether the time limit has passed."""
        return self.settings.seconds is not None and time.monotonic() - self.started >= self.settings.seconds

    def tell(self, doing: str = "") -> None:
        """Report the progress."""
        if self.progress is None:
            return
        settings, covering = self.settings, self.covering
        distinct = sum(failure.confirmed for failure in self.failures.values())
        tried = f", {covering.covered} of {covering.total} tried" if covering else ""
        left = None if settings.seconds is None else max(0.0, self.started + settings.seconds - time.monotonic())
        total = None if settings.covered and covering else settings.trials  # covering ends before that
        self.progress(self.done, total, f"{self.result.failing} failing, {distinct} distinct{tried}{doing}", left)

    @property
    def parallelism(self) -> int:
        """Number of trials at once."""
        return self.runner.parallelism

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Run further trials of cases that failed: the campaign is the runner of these."""
        outcomes = self.runner.run(cases)
        self.tell(", repeating a failure")
        return outcomes

    def case(self, seed: int, injections: tuple[Injection, ...] = ()) -> TestCase:
        """Return a test case of this campaign."""
        return TestCase(self.log, injections, seed, ordered=self.settings.ordered)

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
                    for each in group(self.failures, case, outcome, trial=trial, types=self.schedule.types)
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
        failure.case, failure.rate = repeat_in_order(failure.case, signature, self)
        if not failure.rate.total:
            self.result.notes[f"{signature}: none of its repeats could be judged"] = failure.attempts

    def simplify(self, failure: Failure) -> None:
        """Make the simplest case that fails as often represent a failure, without injections that it does not need."""
        if failure.simpler is not None:
            self._replace(failure, *failure.simpler)
            failure.simpler = None
        for case in plainer(failure):
            (outcome,) = self.run([case])
            if outcome.failed_as(failure.violation.signature) and self._replace(failure, case, failure.trial, outcome):
                break

    def _replace(self, failure: Failure, case: TestCase, trial: int, outcome: Outcome) -> bool:
        """Make another case represent a failure if it fails as often; return whether it does."""
        case, rate = repeat_in_order(case, failure.violation.signature, self)
        as_often = failure.rate is None or rate.rate >= failure.rate.rate
        if as_often:
            failure.represent_by(case, trial, outcome)
            failure.rate = rate
        return as_often

    def check_nominal(self) -> None:
        """Run the nominal log, more often if verdicts differ; if these trials cannot be judged, no others can."""
        cases, outcomes = dict[int, TestCase](), list[Outcome]()
        for count in (4, 16):
            if not outcomes or len({outcome.verdict for outcome in outcomes}) > 1:
                more = {-n: self.case(self.settings.seed + n - 1) for n in range(len(cases) + 1, count + 1)}
                outcomes += self.runner.run(list(more.values()))
                cases |= more
        if unjudged := [outcome for outcome in outcomes if not outcome.judged]:
            why = unjudged[0].detail
            raise EnvironmentFaultError(f"a trial of the nominal log could not be carried out: {why}")
        self._know_alarms(outcomes)
        missing = [dict(outcome.statistics.get("baseless", {})) for outcome in outcomes]
        self.baseless = {key: why for key, why in missing[0].items() if all(key in each for each in missing)}
        self.nominal = list(map(self._judged, outcomes))
        self.judge(cases, self.nominal)
        if self.covering:
            self.covering.nominal_outputs = min(int(one.statistics.get("outputs", 0)) for one in self.nominal)

    def next_batch(self) -> None:
        """Choose the next injected trials together, run and judge them."""
        covering, settings = self.covering, self.settings
        behind = self.done + max(_ROUND, self.runner.parallelism)
        batch = range(self.done, behind if settings.trials is None else min(settings.trials, behind))
        calm = self.calm and not settings.covered
        self.result.calm += len(batch) if calm and covering else 0
        together = {trial: _together(covering, trial, calm=calm) for trial in batch}
        cases = {
            trial: self.case(
                settings.seed,
                tuple(one for placed in chosen for one in placed.injections)
                if chosen
                else self.schedule.injections(trial),
            )
            for trial, (_, chosen) in together.items()
        }
        outcomes = list(map(self._judged, self.runner.run(list(cases.values()))))
        self.done = batch.stop
        self.judge(cases, outcomes)
        for (chooser, chosen), outcome in zip(together.values(), outcomes, strict=True):
            if chooser and chosen:
                chooser.record(chosen, outcome)
        self.tell()

    def account(self) -> CampaignResult:
        """Return the results: the failures, each by its simplest case, and what has to be said of the trials."""
        result, covering, nominal = self.result, self.covering, len(self.nominal)
        for failure in self.failures.values():
            (result.failures if failure.confirmed else result.unconfirmed)[failure.violation.signature] = failure
        for failure in result.failures.values():
            self.simplify(failure)
        every = nominal + self.done - len(result.unjudged)
        blind = {name: next(reversed(each.values())) for name, each in self.unseen.items() if len(each) == every}
        result.notes |= {f"{name}: {why}": every for name, why in blind.items()}
        result.notes |= {f"{name}: {why}, in no nominal trial": nominal for name, why in self.baseless.items()}
        result.notes |= {f"{name}: nominal trials show the same": count for name, count in self.alarms.items()}
        if covering:
            result.tried, result.undecided, result.coverable = covering.tried, covering.undecided, covering.total
        result.trials, result.alarms = nominal + self.done, sorted(self.alarms)
        result.grown.sort(key=lambda each: -each[0])
        return result

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
                controls = more_nominal(case, played, self)
                if usual := sum(one.failed_as(signature) for one in controls):
                    self.alarms[signature] = usual
        return self._judged(outcome)

    def _judged(self, outcome: Outcome) -> Outcome:
        """Return an outcome without violations that say nothing about the unit."""
        if not self.alarms and not self.baseless:
            return outcome
        return outcome.without(lambda each: each.signature in self.alarms or each.signature in self.baseless)


def run_campaign(
    messages: Sequence[Message],
    schedule: Schedule,
    runner: Runner,
    settings: CampaignSettings,
    *,
    covering: Covering | None = None,
    progress: Callable[[int, int | None, str, float | None], object] | None = None,
    found: Callable[[Failure], object] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> CampaignResult:
    """Run trials until the budget ends; each failure is repeated with fresh processes before it counts.

    A unit that always fails on the nominal log is not tested further. One that sometimes fails is tested: its failures
    on the nominal log are findings without injections, with their rates.

    The schedule draws the injections that `covering` does not choose. `progress` is called after each batch, also those
    that repeat failures, with the injected trials so far, their final number (None if unknown), a text on the state,
    and the seconds left (None for no limit); `found` with each failure as soon as it is confirmed; `stop` before each
    batch of injected trials: True ends the campaign.

    Raises:
        EnvironmentFaultError: Trials of the nominal log cannot be judged.
    """
    work = _Campaign(tuple(messages), schedule, runner, settings, covering, progress, found)
    work.check_nominal()
    if work.result.failing == len(work.nominal):
        return work.account()
    while not work.used_up and not work.time_is_over:
        if stop():
            work.result.stopped = True
            break
        work.next_batch()
    work.result.exhausted = work.used_up
    return work.account()


def _together(
    covering: Covering | None, trial: int, *, calm: bool
) -> tuple[Covering | Stretches | None, tuple[Placed, ...]]:
    """Return the variations that a trial tries together, and their chooser; nothing if its injections are drawn."""
    if covering is None:
        return None, ()
    if not (trial + 1) % _DRAWN:
        if unchecked := covering.malformed():
            return covering, unchecked
        policies = covering.policies()
        if policies or (covering.finished and not calm):
            return covering.stretches, policies
    return covering, covering.next(calm=calm) or covering.further()
