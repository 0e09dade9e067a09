"""Step `minimize`: from the failing log to the few messages that are needed (RIOT II-B a)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.generalize.minimize import minimize as search
from riot_bus.vocabulary.trial import TestCase

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

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        cases = [TestCase(log.keep(kept).messages, seed=seed, ordered=finding.ordered) for kept in questions]
        return [outcome.failed_as(finding.signature) for outcome in runner.run(cases)]

    minimal = search(
        n,
        ask,
        weights=weights,
        groups=[context.registry.topic(message.key) for message in log.messages],
        parallelism=runner.parallelism,
        progress=step.progress,
    )
    kept = log.keep(minimal.kept)
    metadata = {"finding": finding.id, "signature": finding.signature, "seed": str(seed)}
    kept.save(folder / "minimal.mcap", context=context, metadata=metadata)
    return MinimalRecord(
        before=n,
        kept=minimal.kept,
        topics=tuple(context.registry.topic(message.key) for message in kept.messages),
        one_minimal=minimal.one_minimal,
    )
