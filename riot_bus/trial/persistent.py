"""Trials that share a process of the unit (see `kept`); failures are repeated with a fresh process.

After each trial, the probe of the verdict tells whether the unit works as before. A process is ended after a failure,
when it has grown, and after a number of trials. If the repetition of a failing case passes, its outcome tells of the
failure with the history.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from riot_bus.trial.baseline import UNKNOWN, Baseline, growth_of
from riot_bus.trial.kept import MOST_TRIALS, KeptSetup, end_kept, kept_folder, not_subscribed, reset_components
from riot_bus.trial.signs import Feeder
from riot_bus.trial.unit_trial import UnitTrial, unit_setup
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from contextlib import ExitStack

    from riot_bus.trial.stage import TrialPlace, TrialSetup
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import TestCase

_CPU_SHARE = 0.5
"""Share of the limit of processor time at which a process is replaced, since the limit is for one trial."""


@dataclass(frozen=True, slots=True)
class PersistentTrial:
    """Runs test cases against a persistent process of a unit; `unit` and `baseline` are those of `UnitTrial`.

    If a case failed after others and passed with a fresh process, the statistics of its outcome have `history`: the
    `violations` (monitor, component, signature, detail), and the digests of the cases `before` it, in their order.
    """

    unit: str
    baseline: Baseline = UNKNOWN

    def run(self, case: TestCase, place: TrialPlace) -> Outcome:
        """Play the case to the unit as it is after earlier cases; if it fails, to a fresh one."""
        live = next((each for each in place.kept if isinstance(each, LiveUnit) and each.fits(self, case)), None)
        if live is None:
            end_kept(place)
        try:
            if live is None:
                live = LiveUnit(self, case, place)
                place.kept.append(live.__enter__())
            outcome = live.play(case)
        except EnvironmentFaultError as error:
            outcome = Outcome(Verdict.ERROR, detail=str(error))
        before = [] if live is None else live.before
        passed = outcome.verdict is Verdict.PASS and live is not None
        if not passed or (live is not None and live.is_spent()):
            end_kept(place)
        if passed:
            return outcome
        fresh = UnitTrial(self.unit, self.baseline).run(case, place)
        if outcome.verdict is not Verdict.FAIL or fresh.verdict is not Verdict.PASS or not before:
            return fresh
        seen = [[each.monitor, each.component, each.signature, each.detail] for each in outcome.violations]
        history = {"violations": seen, "before": [each.digest() for each in before]}
        return replace(fresh, statistics={**fresh.statistics, "history": history})


class LiveUnit(KeptSetup):
    """A running unit with the cases that it has got so far; a context manager.

    Args:
        trial: Trial with the unit and its baseline.
        case: The first test case.
        place: Folder, launcher and system of the trials.

    Attributes:
        before: Cases that the unit got before the last one.
    """

    def __init__(self, trial: PersistentTrial, case: TestCase, place: TrialPlace) -> None:
        self.before: list[TestCase] = []
        self._had: list[TestCase] = []
        self._kind, self._trial = trial, UnitTrial(trial.unit, trial.baseline)
        self._place, self._first = place, case
        file = place.context.alone(trial.unit).file
        self._name, self._unit = file.component_of(trial.unit), file.unit[trial.unit]
        self._component = file.components[self._name]
        self._seeded = any("{seed}" in text for text in file.texts_of(self._component))
        self._keys = {each.key for each in (*case.messages, *trial.baseline.probe)}
        self._where = f"{file.path}: [unit.{trial.unit}] reset"

    def _open(self, stack: ExitStack) -> TrialSetup:
        folder = kept_folder(self._place, stack)
        stage = stack.enter_context(unit_setup(self._trial.unit, self._place, directory=folder))
        self._trial.start(stage, self._first)
        reset = self._unit.reset
        if reset is not None and reset.topic is not None:
            keys, timeout = stage.context.topics(reset.topic), self._unit.settle.timeout
            if stage.bus.wait_subscribed(stage.segment_of(self._name), keys, timeout=timeout):
                raise not_subscribed(reset.topic, where=self._where)
        stage.sample_resources([self._name])
        self._born = stage.samples(self._name)[0]
        return stage

    def fits(self, trial: PersistentTrial, case: TestCase) -> bool:
        """Return whether a case can be played to the unit: trial and seed are the same, and it reads all keys."""
        same = trial is self._kind or trial == self._kind
        seeded = self._seeded and case.seed != self._first.seed
        return same and not seeded and self._keys >= {each.key for each in case.messages}

    def play(self, case: TestCase) -> Outcome:
        """Reset the unit, if riot.toml says how, and play a case to it.

        Raises:
            EnvironmentFaultError: The machine is too busy for a verdict.
        """
        self.before = list(self._had)
        self._had.append(case)
        if self.before:
            if self._unit.reset is not None:
                timeout = self._unit.settle.timeout
                reset_components(self.stage, self._unit.reset, self._feed, where=self._where, timeout=timeout)
            self.stage.renew()
        outcome = self._trial.play(self.stage, case)
        started = f"persistent, {outcome.statistics['started']}"
        return replace(outcome, statistics={**outcome.statistics, "started": started})

    def _feed(self, message: Message) -> bool:
        Feeder(self.stage, self._name, self._unit, self._trial.baseline).feed([message])
        return True  # it had subscribed when it was started

    def is_spent(self) -> bool:
        """Return whether the process has to be replaced: it has grown, has run for long, or has had many cases.

        A process with limited resources is replaced after each case, so that it does not keep them from others.
        """
        if len(self._had) >= MOST_TRIALS or self._component.resources or self._component.attach:
            return True
        last = self.stage.samples(self._name)[-1]
        if self._trial.baseline.grown(growth_of([self._born, last]), messages=0, input_bytes=0):
            return True
        limits = self._component.limits
        if limits == "off" or not limits.cpu:
            return False
        ran = sum(times[0] for times in self.stage.activity([self._name]).threads.values()) / 1e9
        return ran > _CPU_SHARE * limits.cpu
