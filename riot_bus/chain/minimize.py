"""Step `minimize`: from the failing log to the few messages that are needed (RIOT II-B a)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog
from riot_bus.chain.questions import FreshCases, noise_of
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.generalize.minimize import BUDGET, Minimal
from riot_bus.generalize.minimize import minimize as search
from riot_bus.vocabulary.trial import Ask, TestCase

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun

__all__ = ["minimize"]

_INJECTED = 20.0
_RECENT = 1.0
_UNMODIFIED, _DOUBT = 0.1, 0.02
"""Prior that what was kept fails without its modifications, and what decides about it."""


def minimize(step: StepRun, folder: Path, *, budget: int = BUDGET) -> MinimalRecord:
    """Shrink `failure.mcap` to `minimal.mcap`: fails with the same signature, and no message can be taken away.

    When it is interrupted, the best so far is kept, and said not to be proven.

    Args:
        step: The running step.
        folder: The finding.
        budget: Most trials.

    Raises:
        InconclusiveError: The failing log does not fail again.
    """
    return _Minimization(step, folder, budget).run()


class _Minimization:
    """The state of one run of the step."""

    def __init__(self, step: StepRun, folder: Path, budget: int) -> None:
        self.step = step
        self.folder = folder
        self.budget = budget
        self.finding = FindingRecord.load(folder)
        self.context = step.workspace.context
        self.log = FailingLog.load(folder / "failure.mcap", registry=self.context.registry)
        self.cases = FreshCases(step.unit_runner(self.finding.unit))
        nominal = self.finding.nominal
        modified = [i for i, message in enumerate(self.log.messages) if message.sequence in self.log.originals]
        self.causes = modified if modified and nominal is not None and nominal.count == 0 else None
        self.missing: tuple[str, ...] = ()
        self.missing_failed = (0, 0)

    def run(self) -> MinimalRecord:
        best: list[Minimal] = []
        try:
            minimal = self._shrunk(self._failing, best, self.budget)
            if self.causes is not None and minimal.kept and self._fails_unmodified(minimal):
                left = self.budget - minimal.trials - self.missing_failed[1]
                best.clear()  # what was found so far has another cause
                minimal = self._shrunk(self._failing_if_modified, best, left)
        except KeyboardInterrupt:
            if best and not MinimalRecord.exists(self.folder):
                figures = {"seed": self.step.workspace.seed, "trials": self.step.trials, "seconds": self.step.seconds}
                self._saved(best[-1]).model_copy(update={"interrupted": True, **figures}).save(self.folder)
            raise
        return self._saved(minimal)

    def _shrunk(self, ask: Ask[tuple[int, ...]], best: list[Minimal], budget: int) -> Minimal:
        n = len(self.log.messages)
        return search(
            n,
            ask,
            weights=[
                (_INJECTED if message.sequence in self.log.originals else 0.1) + _RECENT * (index + 1) / n
                for index, message in enumerate(self.log.messages)
            ],
            groups=[self.context.registry.topic(message.key) for message in self.log.messages],
            causes=self.causes,
            noise=noise_of(self.finding),
            budget=budget,
            parallelism=self.cases.parallelism,
            progress=self.step.progress,
            better=best.append,
        )

    def _failed(self, logs: Sequence[FailingLog]) -> list[bool]:
        seed, ordered = self.step.workspace.seed, self.finding.ordered
        outcomes = self.cases.run([TestCase(one.messages, seed=seed, ordered=ordered) for one in logs])
        return [outcome.failed_as(self.finding.signature) for outcome in outcomes]

    def _failing(self, questions: Sequence[tuple[int, ...]]) -> list[bool]:
        return self._failed([self.log.keep(kept) for kept in questions])

    def _failing_if_modified(self, questions: Sequence[tuple[int, ...]]) -> list[bool]:
        """Whether parts of the log fail that do not fail with the originals of what was modified."""
        answers = self._failing(questions)
        failed = [kept for kept, answer in zip(questions, answers, strict=True) if answer]
        unmodified = self._failed([self.log.keep(kept).restored() for kept in failed])
        same = dict(zip(failed, unmodified, strict=True))
        return [answer and not same[kept] for kept, answer in zip(questions, answers, strict=True)]

    def _fails_unmodified(self, minimal: Minimal) -> bool:
        """Whether what was kept fails with the originals, too: then it fails since other messages are missing."""
        kept = self.log.keep(minimal.kept)
        failed = total = 0
        chance = _UNMODIFIED
        while total < 1 or _DOUBT < chance < 1 - _DOUBT:
            failed, total = failed + sum(self._failed([kept.restored()])), total + 1
            chance = minimal.noise.triggers(failed, total - failed, prior=_UNMODIFIED)
        if chance < 0.5:
            return False
        self.missing = tuple(dict.fromkeys(self.context.registry.topic(message.key) for message in kept.messages))
        self.missing_failed = (failed, total)
        return True

    def _saved(self, minimal: Minimal) -> MinimalRecord:
        """Write `minimal.mcap` and return what it is."""
        kept = self.log.keep(minimal.kept)
        metadata = {
            "finding": self.finding.id,
            "signature": self.finding.signature,
            "seed": str(self.step.workspace.seed),
        }
        kept.save(self.folder / "minimal.mcap", context=self.context, metadata=metadata)
        return MinimalRecord(
            before=len(self.log.messages),
            kept=minimal.kept,
            topics=tuple(self.context.registry.topic(message.key) for message in kept.messages),
            one_minimal=minimal.one_minimal,
            confidence=minimal.confidence,
            failed=minimal.failed,
            without=minimal.without,
            missing=self.missing,
            missing_failed=self.missing_failed,
        )
