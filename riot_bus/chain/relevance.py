"""Step `relevance`: which fields of the minimal log matter, each with a certificate (RIOT II-B b)."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog, NamedField, NamedFields, nominal_values
from riot_bus.chain.robustness import dictionary_of
from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, FindingRecord, MinimalRecord, Value
from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.relevance import FieldSpace, RelevantField, relevant_fields
from riot_bus.inject.brittle import why_brittle
from riot_bus.types.exceptional import entries_of
from riot_bus.vocabulary.trial import Scalar, TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.campaign.store import StoredRunner
    from riot_bus.chain.workspace import Workspace
    from riot_bus.inject.dictionary import Dictionary
    from riot_bus.sut.system import Unit

__all__ = ["draws_for", "plain", "relevance"]

_REPEATS = 3
_ROUNDS = 4
_STRAIGHT = 12
_OBSERVED = 8
_INJECTED_PRIOR = 10.0


def plain(value: Scalar) -> Value:
    """Return a value as JSON can hold it."""
    return value.hex() if isinstance(value, bytes) else value


def draws_for(field: NamedField, dictionary: Dictionary, observed: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Return replacement values for a field: exceptional ones, and some that it had in the nominal log."""
    told = entries_of(field.kind, field.payload, field.leaf.path)
    known = dictionary.values_for(field.leaf.type, f"{field.topic}:{field.leaf.path}", told=told)
    entries = [entry.value for entry in known]
    some = list(observed[:: max(1, len(observed) // _OBSERVED)])[:_OBSERVED]
    values: list[Scalar] = []
    for value in (*some, *entries):
        if not any(same_scalar(value, other) for other in values):
            values.append(value)
    return tuple(values)


def _considered(fields: NamedFields, unit: Unit) -> list[NamedField]:
    def wanted(field: NamedField) -> bool:
        name = f"{field.topic}:{field.leaf.path}"
        if field.original is not None or any(fnmatchcase(name, pattern) for pattern in unit.include):
            return True
        return not why_brittle(field.leaf.path, field.kind) and not any(
            fnmatchcase(name, pattern) for pattern in unit.leave
        )

    return [field for field in fields.fields.values() if wanted(field)]


def relevance(workspace: Workspace, folder: Path) -> FieldsRecord:
    """Find the relevant fields of `minimal.mcap` and write `fields.json` and the certificates' logs.

    Each certificate's trials are repeated; an answer that its repetitions contradict is corrected, and the search done
    again with it (all other answers come from the store).

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: The minimal log does not fail again.
    """
    finding, _ = FindingRecord.load(folder), MinimalRecord.load(folder)
    registry = workspace.context.registry
    fields = NamedFields(FailingLog.load(folder / "minimal.mcap", registry=registry), registry=registry)
    considered = _considered(fields, workspace.context.file.unit[finding.unit])
    paths: dict[str, set[str]] = {}
    for field in considered:
        paths.setdefault(field.topic, set()).add(field.leaf.path)
    observed = nominal_values(workspace.unit_log(finding.unit), paths, registry=registry)
    dictionary = dictionary_of(workspace, finding.unit)
    spaces = [
        FieldSpace(
            field.name,
            field.leaf.value,
            field.original,
            draws_for(field, dictionary, observed[f"{field.topic}:{field.leaf.path}"]),
            prior=1.0 if field.original is None else _INJECTED_PRIOR,
        )
        for field in considered
    ]
    with workspace.step("relevance") as step:
        runner = step.unit_runner(finding.unit)

        corrected: dict[str, bool] = {}

        def ask(questions: Sequence[Mapping[str, Scalar]]) -> list[bool]:
            cases = [TestCase(fields.with_values(values), seed=workspace.seed) for values in questions]
            failed = [outcome.failed_as(finding.signature) for outcome in runner.run(cases)]
            return [corrected.get(case.digest(), answer) for case, answer in zip(cases, failed, strict=True)]

        for _ in range(_ROUNDS):
            found = relevant_fields(
                spaces,
                ask,
                seed=workspace.seed,
                straight=_STRAIGHT,
                parallelism=runner.parallelism,
                progress=step.progress,
            )
            records = tuple(_confirmed(workspace, folder, fields, one, runner, finding) for one in found.fields)
            wrong = _contradicted(records, found.fields, fields, seed=workspace.seed)
            if not wrong:
                break
            corrected.update(wrong)
        record = FieldsRecord(
            fields=records,
            considered=tuple(field.name for field in considered),
            bound=min(1.0, found.bound),
            straight=found.straight,
            seed=workspace.seed,
            trials=step.trials,
            seconds=step.seconds,
        )
        record.save(folder)
        names = ", ".join(f"{one.name} ({one.kind})" for one in records) or "none"
        workspace.narrator.end("relevance", f"{len(considered)} fields -> {names} ({step.trials} trials)")
    return record


def _contradicted(
    records: Sequence[FieldRecord], found: Sequence[RelevantField], fields: NamedFields, *, seed: int
) -> dict[str, bool]:
    """Return the answers, by digest, that most of the repetitions of a certificate's trials contradict."""
    wrong = {}
    for record, one in zip(records, found, strict=True):
        certificate = record.certificate
        if 2 * certificate.confirmed_failing < certificate.repeats:
            wrong[TestCase(fields.with_values(one.certificate.failing), seed=seed).digest()] = False
        if 2 * certificate.confirmed_passing < certificate.repeats:
            wrong[TestCase(fields.with_values(one.certificate.passing), seed=seed).digest()] = True
    return wrong


def _confirmed(
    workspace: Workspace,
    folder: Path,
    fields: NamedFields,
    found: RelevantField,
    runner: StoredRunner,
    finding: FindingRecord,
) -> FieldRecord:
    """Repeat both trials of a certificate with fresh processes and keep their logs."""
    logs, counts = [], []
    for side, values in (("failing", found.certificate.failing), ("passing", found.certificate.passing)):
        messages = fields.with_values(values)
        path = folder / "certificates" / f"{re.sub(r'[^A-Za-z0-9]+', '-', found.name).strip('-')}.{side}.mcap"
        path.parent.mkdir(exist_ok=True)
        metadata = {"finding": finding.id, "field": found.name, "side": side}
        FailingLog(messages, fields.log.originals).save(path, context=workspace.context, metadata=metadata)
        logs.append(str(path.relative_to(folder)))
        outcomes = runner.run([TestCase(messages, seed=workspace.seed + 1 + again) for again in range(_REPEATS)])
        if side == "failing":
            counts.append(sum(outcome.failed_as(finding.signature) for outcome in outcomes))
        else:
            counts.append(sum(outcome.verdict is Verdict.PASS for outcome in outcomes))
    certificate = CertificateRecord(
        failing=plain(found.certificate.failing[found.name]),
        passing=plain(found.certificate.passing[found.name]),
        others={name: plain(value) for name, value in found.certificate.failing.items() if name != found.name},
        failing_log=logs[0],
        passing_log=logs[1],
        confirmed_failing=counts[0],
        confirmed_passing=counts[1],
        repeats=_REPEATS,
    )
    leaf = fields.fields[found.name].leaf
    return FieldRecord(
        name=found.name, kind=found.kind, type=leaf.type, failing=plain(leaf.value), certificate=certificate
    )
