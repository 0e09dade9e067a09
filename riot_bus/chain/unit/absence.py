"""Failures because messages are missing: which ones, and a separate finding if modified messages fail, too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.unit.questions import FreshCases, unit_case
from riot_bus.findings.records import AbsentRecord, FindingRecord, ProportionRecord
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.oracle import BudgetSpentError, Trials
from riot_bus.statistics.noise import Noise
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import TestCase


def absent_messages(
    step: StepRun, finding: FindingRecord, log: FailingLog, cases: FreshCases, noise: Noise, *, unprobed: bool = False
) -> AbsentRecord | None:
    """Return the fewest messages of the nominal log without which a part of it fails; None if this is unknown."""
    workspace, registry = step.workspace, step.workspace.context.registry
    nominal = workspace.known_unit_log(finding.unit)
    kept = [message.sequence for message in log.messages]
    if kept != sorted(set(kept)) or not all(
        number < len(nominal) and nominal[number].digest() == message.digest()
        for number, message in zip(kept, log.messages, strict=True)
    ):
        return None  # not a part of the nominal log in its order, so the cause may be another one
    others = [number for number in range(len(nominal)) if number not in set(kept)]
    topics = [registry.topic(message.key) for message in nominal]
    last = kept[-1] if kept else len(nominal)
    # with the first message of a topic the unit starts; those after the failure come last
    weights = [0.01 if number > last else 10.0 if topics.index(topics[number]) == number else 1.0 for number in others]
    trials: Trials[TestCase] = Trials(
        lambda asked: cases.failures(asked, finding.signature),
        key=TestCase.digest,
        noise=noise,
        budget=1000,
        parallelism=cases.parallelism,
    )

    def with_(places: Sequence[int]) -> TestCase:
        numbers = sorted([*kept, *(others[place] for place in places)])
        messages = [nominal[number].with_(sequence=number) for number in numbers]
        return unit_case(workspace, finding, messages, unprobed=unprobed)

    def heals(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        asked = [with_(places) for places in questions]
        # about twenty answers lead to the result, and a wrong one is not corrected
        return [not fails for fails in trials.decide(asked, doubt=0.005, doing="looking for what is missing")]

    try:
        groups, parallelism = [topics[number] for number in others], cases.parallelism
        minimal = minimize(
            len(others), heals, weights=weights, groups=groups, parallelism=parallelism, progress=step.progress
        )
    except (InconclusiveError, BudgetSpentError):  # the nominal log fails, too, or the failure is too rare
        return None
    if not minimal.kept or not minimal.one_minimal:
        return None
    failed, passed = trials.counts(with_(minimal.kept))
    numbers = tuple(others[place] for place in minimal.kept)
    missing = tuple(topics[number] for number in numbers)
    return AbsentRecord(numbers=numbers, topics=missing, passed=(passed, failed + passed))


def other_cause(folder: Path) -> Path:
    """Return the folder for the finding that fails in the same place because messages are missing."""
    return folder.with_name(f"{folder.name}-missing")


def write_other_cause(
    step: StepRun, folder: Path, finding: FindingRecord, log: FailingLog, failed: tuple[int, int]
) -> Path:
    """Write the finding of a log that fails in the same place with nothing modified; return its folder."""
    workspace = step.workspace
    other = other_cause(folder)
    other.mkdir(exist_ok=True)
    record = finding.model_copy(
        update={
            "id": other.name,
            "occurrences": failed[0],
            "rate": ProportionRecord.of(proportion(*failed)),
            "injections": (),
            "delivered": (),
            "messages": len(log.messages),
            "modified": 0,
        }
    )
    metadata = record.provenance | {"seed": str(workspace.seed)}
    log.save(other / "failure.mcap", context=workspace.context, metadata=metadata)
    new = not FindingRecord.exists(other)
    workspace.write_finding(other, record)
    if new:
        workspace.tell_finding(step.name, other, record)
    return other
