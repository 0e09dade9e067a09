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

    from riot_bus.chain.workspace import Workspace

__all__ = ["minimize"]

_INJECTED = 20.0
_RECENT = 1.0


def minimize(workspace: Workspace, folder: Path) -> MinimalRecord:
    """Shrink `failure.mcap` to `minimal.mcap`: fails with the same signature, and no message can be taken away.

    Raises:
        InconclusiveError: The failing log does not fail again.
    """
    finding = FindingRecord.load(folder)
    registry = workspace.context.registry
    log = FailingLog.load(folder / "failure.mcap", registry=registry)
    n = len(log.messages)
    weights = [
        (_INJECTED if message.sequence in log.originals else 0.1) + _RECENT * (index + 1) / n
        for index, message in enumerate(log.messages)
    ]
    with workspace.step("minimize") as step:
        runner = step.unit_runner(finding.unit)

        def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
            cases = [TestCase(log.keep(kept).messages, seed=workspace.seed) for kept in questions]
            return [outcome.failed_as(finding.signature) for outcome in runner.run(cases)]

        minimal = search(
            n,
            ask,
            weights=weights,
            groups=[registry.topic(message.key) for message in log.messages],
            parallelism=runner.parallelism,
            progress=step.progress,
        )
        kept = log.keep(minimal.kept)
        metadata = {"finding": finding.id, "signature": finding.signature, "seed": str(workspace.seed)}
        kept.save(folder / "minimal.mcap", context=workspace.context, metadata=metadata)
        record = MinimalRecord(
            before=n,
            kept=minimal.kept,
            topics=tuple(registry.topic(message.key) for message in kept.messages),
            one_minimal=minimal.one_minimal,
            seed=workspace.seed,
            trials=step.trials,
            seconds=step.seconds,
        )
        record.save(folder)
        needed = ", ".join(record.topics) or "none (it fails without any input)"
        workspace.narrator.end("minimize", f"{n} messages -> {len(kept.messages)}: {needed} ({step.trials} trials)")
    return record
