"""Step `minimize`: from the failing log to the few messages that are needed (RIOT II-B a)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.generalize.minimize import Minimal
from riot_bus.generalize.minimize import minimize as search
from riot_bus.vocabulary.trial import Ask, TestCase

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun

__all__ = ["minimize"]

_INJECTED = 20.0
_RECENT = 1.0


def minimize(step: StepRun, folder: Path) -> MinimalRecord:
    """Shrink `failure.mcap` to `minimal.mcap`: fails with the same signature, and no message can be taken away.

    Args:
        step: The running step.
        folder: The finding.

    Raises:
        InconclusiveError: The failing log does not fail again.
    """
    finding = FindingRecord.load(folder)
    context, seed = step.workspace.context, step.workspace.seed
    log = FailingLog.load(folder / "failure.mcap", registry=context.registry)
    n = len(log.messages)
    weights = [
        (_INJECTED if message.sequence in log.originals else 0.1) + _RECENT * (index + 1) / n
        for index, message in enumerate(log.messages)
    ]
    runner = step.unit_runner(finding.unit)
    modified = {index for index, message in enumerate(log.messages) if message.sequence in log.originals}
    caused = bool(modified) and finding.nominal is not None and finding.nominal.count == 0

    def failing(logs: Sequence[FailingLog]) -> list[bool]:
        cases = [TestCase(one.messages, seed=seed, ordered=finding.ordered) for one in logs]
        return [outcome.failed_as(finding.signature) for outcome in runner.run(cases)]

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        """Whether parts of the log fail; if the whole log only does so modified, one without any such message does not.

        What fails because messages are missing has another cause, whatever its signature.
        """
        possible = [kept for kept in questions if not caused or modified.intersection(kept)]
        answers = dict(zip(possible, failing([log.keep(kept) for kept in possible]), strict=True))
        return [answers.get(kept, False) for kept in questions]

    def ask_strictly(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        """Whether parts of the log fail that do not fail with the originals of what was modified."""
        answers = ask(questions)
        failed = [kept for kept, answer in zip(questions, answers, strict=True) if answer]
        unmodified = dict(zip(failed, failing([log.keep(kept).restored() for kept in failed]), strict=True))
        return [answer and not unmodified[kept] for kept, answer in zip(questions, answers, strict=True)]

    def shrink(ask: Ask[tuple[int, ...]]) -> Minimal:
        return search(
            n,
            ask,
            weights=weights,
            groups=[context.registry.topic(message.key) for message in log.messages],
            parallelism=runner.parallelism,
            progress=step.progress,
        )

    minimal = shrink(ask)
    if caused and failing([log.keep(minimal.kept).restored()])[0]:
        minimal = shrink(ask_strictly)
    kept = log.keep(minimal.kept)
    metadata = {"finding": finding.id, "signature": finding.signature, "seed": str(seed)}
    kept.save(folder / "minimal.mcap", context=context, metadata=metadata)
    return MinimalRecord(
        before=n,
        kept=minimal.kept,
        topics=tuple(context.registry.topic(message.key) for message in kept.messages),
        one_minimal=minimal.one_minimal,
    )
