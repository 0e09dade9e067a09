"""Step `relevance`: which fields of the minimal log matter, each with a certificate (RIOT II-B b)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from riot_bus.chain.base.logs import FailingLog, NamedField, NamedFields
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.unit.orders import order_spaces
from riot_bus.chain.unit.questions import FreshCases, UnitQuestions, draws_for, json_value
from riot_bus.chain.unit.structure import parts_of, search_structure
from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, MinimalRecord, StructureRecord
from riot_bus.generalize.oracle import scalar_key
from riot_bus.generalize.relevance import BUDGET, FieldSpace, RelevantField, relevant_fields
from riot_bus.statistics.noise import Noise
from riot_bus.system.system_file import Unit
from riot_bus.trial.context import Context
from riot_bus.types.brittle import why_brittle
from riot_bus.vocabulary.field_pattern import names_field
from riot_bus.vocabulary.order import order_of
from riot_bus.vocabulary.trial import Ask

_DOUBT, _REFUTED = 0.05, 0.002
"""Doubt that still confirms a side, and probability that drops it: low, so that bad luck does not refute the search."""
_AFTER = 1000
"""Number of first trials to skip, so that those by which the minimal log was chosen do not count."""

QuestionT = TypeVar("QuestionT")


def considered_fields(fields: NamedFields, unit: Unit) -> list[NamedField]:
    """Return the fields that may be varied: all but the brittle ones and those that riot.toml leaves alone.

    A brittle field is varied if the same field of another message of its topic was injected: the failure may depend on
    both, such as on decreasing sequence numbers.
    """
    injected = {(field.topic, field.leaf.path) for field in fields.fields.values() if field.original is not None}

    def wanted(field: NamedField) -> bool:
        name = f"{field.topic}:{field.leaf.path}"
        if field.original is not None or any(names_field(pattern, name) for pattern in unit.include):
            return True
        brittle = why_brittle(field.leaf.path, field.kind) and (field.topic, field.leaf.path) not in injected
        return not brittle and not any(names_field(pattern, name) for pattern in unit.leave)

    return [field for field in fields.fields.values() if wanted(field)]


def relevance(step: StepRun, folder: Path, *, budget: int = BUDGET) -> FieldsRecord:
    """Find the relevant fields of `minimal.mcap` and write the certificates' logs.

    Both trials of each certificate are repeated until fresh trials alone confirm it, or it is dropped. Further trials
    show what the failure needs besides values: keys, the order of messages, times between them.

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: The minimal log does not fail again.
    """
    MinimalRecord.load(folder)
    context = step.workspace.context
    questions = UnitQuestions(step, folder)
    considered = considered_fields(questions.fields, context.file.unit[questions.finding.unit])
    ask = questions.fresh(after=_AFTER)
    spaces = [*field_spaces(questions, considered), *order_spaces(questions.fields)]
    found = relevant_fields(
        spaces,
        ask,
        seed=step.workspace.seed,
        noise=questions.noise,
        budget=budget,
        parallelism=questions.runner.parallelism,
        progress=step.progress,
    )
    records, unconfirmed = [], []
    for one in found.fields:
        sides = [_repeated(one.certificate.failing, 1, ask, found.noise)]
        if sides[0].confirmed:
            sides.append(_repeated(one.certificate.passing, 0, ask, found.noise))
        if all(side.confirmed for side in sides):
            records.append(_record(context, folder, one, questions, sides))
        else:
            unconfirmed.append(one.name)
    if any(order_of(one.name) for one in records) and not questions.finding.ordered:
        questions.finding.model_copy(update={"ordered": True}).save(folder)
    record = FieldsRecord(
        fields=tuple(records),
        considered=tuple(space.name for space in spaces),
        bound=found.bound,
        straight=found.straight,
        unconfirmed=tuple(unconfirmed),
        complete=found.complete,
        left=tuple(sorted(questions.fields.fields.keys() - {field.name for field in considered})),
    )
    return _with_structure(step, folder, record, questions, considered, found.noise, budget - found.trials)


def _with_structure(
    step: StepRun,
    folder: Path,
    record: FieldsRecord,
    questions: UnitQuestions,
    considered: Sequence[NamedField],
    noise: Noise,
    budget: int,
) -> FieldsRecord:
    """Return the record with what matters besides values, each confirmed by fresh trials alone."""
    unit = step.workspace.context.file.unit[questions.finding.unit]
    known = {*(one.name for one in record.fields), *record.unconfirmed}
    parts = parts_of(questions.fields, considered, known, paced=unit.rate > 0)
    if not parts:
        return record
    cases = FreshCases(questions.runner, after=2 * _AFTER)
    several = len({message.key for message in questions.fields.log.messages}) > 1

    def ask(logs: Sequence[FailingLog]) -> list[bool]:
        asked = [questions.case_of(log.messages) for log in logs]
        asked = [replace(case, ordered=case.ordered or several) for case in asked]  # else their order tells nothing
        return cases.failures(asked, questions.finding.signature)

    structure = search_structure(
        questions.fields.log,
        parts,
        ask,
        noise=noise,
        budget=budget,
        parallelism=questions.runner.parallelism,
        progress=step.progress,
    )
    found = []
    for number, one in enumerate(structure.needed):
        sides = [_repeated(one.failing, 1, ask, noise), _repeated(one.passing, 0, ask, noise)]
        if not all(side.confirmed for side in sides):
            continue
        part, (failed, passed) = one.part, ((side.right, side.total) for side in sides)
        metadata = {"finding": questions.finding.id, part.kind: f"{part.name} {part.then}".strip()}
        stem = f"{part.kind.replace(' ', '-')}-{number}"
        logs = _write_logs(folder, stem, one.failing, one.passing, context=step.workspace.context, metadata=metadata)
        found.append(
            StructureRecord(kind=part.kind, name=part.name, then=part.then, failed=failed, passed=passed, **logs)
        )
    doubtful = Counter[str](one.part.kind for one in structure.needed) - Counter[str](one.kind for one in found)
    decided = {kind: count - doubtful[kind] for kind, count in structure.asked.items()}
    return record.model_copy(
        update={"structure": tuple(found), "structure_known": decided, "structure_failed": structure.failed}
    )


def field_spaces(questions: UnitQuestions, considered: Sequence[NamedField]) -> list[FieldSpace]:
    """Return for each field the values that may replace the one that it has in the minimal log."""
    observed = questions.nominal(considered)
    return [
        FieldSpace(
            field.name,
            field.leaf.value,
            field.original,
            draws_for(field, questions.dictionary, observed[field.name]),
            observed=tuple({scalar_key(value): value for value in observed[field.name]}.values()),
        )
        for field in considered
    ]


@dataclass(frozen=True, slots=True)
class _Side:
    """Fresh trials of one side of a certificate: the number with the expected outcome, and of all."""

    right: int
    total: int
    confirmed: bool


def _repeated(side: QuestionT, fails: int, ask: Ask[QuestionT], noise: Noise) -> _Side:
    """Repeat one side of a certificate until fresh trials alone decide about it, or their limit is reached."""
    failed = total = 0
    while True:
        count = max(1, 3 - total)
        failed, total = failed + sum(ask([side] * count)), total + count
        chance = noise.triggers(failed, total - failed)
        sure = chance if fails else 1 - chance
        if not _REFUTED < sure < 1 - _DOUBT or total >= 30:  # enough at a failure rate of 0.2
            return _Side(failed if fails else total - failed, total, sure >= 1 - _DOUBT)


def _record(
    context: Context, folder: Path, found: RelevantField, questions: UnitQuestions, sides: Sequence[_Side]
) -> FieldRecord:
    """Write the two logs of a certificate and return the field's record."""
    both = (found.certificate.failing, found.certificate.passing)
    logs = (FailingLog(questions.fields.with_values(one), questions.fields.log.originals) for one in both)
    metadata = {"finding": questions.finding.id, "field": found.name}
    stem = re.sub(r"[^A-Za-z0-9]+", "-", found.name).strip("-")
    failing, passing = sides
    certificate = CertificateRecord(
        failing=json_value(found.certificate.failing[found.name]),
        passing=json_value(found.certificate.passing[found.name]),
        others={name: json_value(value) for name, value in found.certificate.failing.items() if name != found.name},
        **_write_logs(folder, stem, *logs, context=context, metadata=metadata),
        confirmed_failing=failing.right,
        repeats=failing.total,
        confirmed_passing=passing.right,
        passing_repeats=passing.total,
    )
    field = questions.fields.fields.get(found.name)
    type_, value = (field.leaf.type, json_value(field.leaf.value)) if field else ("bool", True)  # an order
    return FieldRecord(name=found.name, kind=found.kind, type=type_, failing=value, certificate=certificate)


def _write_logs(
    folder: Path, stem: str, failing: FailingLog, passing: FailingLog, *, context: Context, metadata: Mapping[str, str]
) -> dict[str, str]:
    """Write the two logs of a certificate; return their paths within the finding's folder, as a record has them."""
    paths = {}
    (folder / "certificates").mkdir(exist_ok=True)
    for side, log in (("failing", failing), ("passing", passing)):
        path = folder / "certificates" / f"{stem}.{side}.mcap"
        log.save(path, context=context, metadata={**metadata, "side": side})
        paths[f"{side}_log"] = str(path.relative_to(folder))
    return paths
