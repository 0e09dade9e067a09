"""Trials that share a process of the unit, which saves starts; failures are repeated with a fresh process.

After each trial, the probe of the verdict tells whether the unit works as before. A process is ended after a failure,
when it has grown, and after a number of trials. A case that fails is executed again at once with a fresh process, and
that outcome counts, so that no failure depends on the history. If the fresh trial passes, its outcome tells of the
failure with the history.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

from riot_bus.sut.baseline import UNKNOWN, Baseline, growth_of
from riot_bus.sut.scarce import held
from riot_bus.sut.signs import Feeder
from riot_bus.sut.stage import TrialSetup
from riot_bus.sut.unit_trial import UnitTrial, component_of
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from riot_bus.sut.stage import TrialPlace
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["KEPT", "LiveUnit", "PersistentTrial", "end_kept"]

KEPT = "persistent-{}-"
"""Prefix of the folder of a persistent process, with the process id of the worker."""
_MOST_TRIALS = 100
"""Largest number of trials of one process, and thus of a history, so that a start costs less than 1 % of the time."""
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


def end_kept(place: TrialPlace) -> None:
    """End everything that is kept over trials, since the next trial needs the place for itself."""
    while place.kept:
        place.kept.pop().__exit__(None, None, None)


class LiveUnit:
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
        self._place, self._context = place, place.context.alone(trial.unit)
        self._file = self._context.file
        self._name = component_of(self._file, trial.unit)
        component = self._file.components[self._name]
        self._seeded = any("{seed}" in text for text in self._file.texts_of(component))
        self._limits = component.limits
        self._first = case
        self._keys = {each.key for each in (*case.messages, *trial.baseline.probe)}
        self._stack = ExitStack()
        self._stage: TrialSetup

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(held(self._file, [self._name]))
            folder = Path(tempfile.mkdtemp(prefix=KEPT.format(os.getpid()), dir=self._place.directory.parent))
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
            self._stage = stack.enter_context(
                TrialSetup(
                    self._context,
                    self._place.launcher,
                    folder,
                    segments=[self._file.segment_of(self._file.components[self._name])],
                    stall=self._file.unit[self._trial.unit].settle.timeout,
                    imports=self._place.imports,
                    attach=[self._name],
                    network=self._place.network,
                )
            )
            self._trial.start(self._stage, self._first)
            self._check_reset()
            self._stage.sample_resources([self._name])
            self._born = self._stage.samples(self._name)[0]
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

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
            self._reset()
            self._stage.renew()
        outcome = self._trial.play(self._stage, case)
        started = f"persistent, {outcome.statistics['started']}"
        return replace(outcome, statistics={**outcome.statistics, "started": started})

    def _check_reset(self) -> None:
        """Raise ConfigError if the message that is to reset the unit does not reach it."""
        unit = self._file.unit[self._trial.unit]
        if unit.reset is None or unit.reset.topic is None:
            return
        segment = self._file.segment_of(self._file.components[self._name])
        keys = self._place.context.topics(unit.reset.topic)
        if self._stage.bus.wait_subscribed(segment, keys, timeout=unit.settle.timeout):
            raise ConfigError(
                f"the unit has not subscribed to {unit.reset.topic}",
                where=f"{self._file.path}: [unit.{self._trial.unit}] reset",
                hint="name a topic that resets it, or leave `reset` out",
            )

    def _reset(self) -> None:
        unit = self._file.unit[self._trial.unit]
        if unit.reset is None:
            return
        if unit.reset.topic is None:
            self._stage.execute("reset", unit.reset.command, timeout=unit.settle.timeout)
            return
        (key,) = self._place.context.topics(unit.reset.topic)
        message = Message(time.time_ns(), key, unit.reset.payload.encode(), encoding=unit.reset.encoding)
        Feeder(self._stage, self._name, unit, self._trial.baseline).feed([message])

    def is_spent(self) -> bool:
        """Return whether the process has to be replaced: it has grown, has run for long, or has had many cases.

        A process with limited resources is replaced after each case, so that it does not keep them from others.
        """
        component = self._file.components[self._name]
        if len(self._had) >= _MOST_TRIALS or component.resources or component.attach:
            return True
        last = self._stage.samples(self._name)[-1]
        if self._trial.baseline.grown(growth_of([self._born, last]), messages=0, input_bytes=0):
            return True
        if self._limits == "off" or not self._limits.cpu:
            return False
        ran = sum(times[0] for times in self._stage.activity([self._name]).threads.values()) / 1e9
        return ran > _CPU_SHARE * self._limits.cpu
