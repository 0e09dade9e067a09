"""Step `relevance`: which fields of the minimal log matter, each with a certificate (RIOT II-B b)."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog, NamedField, NamedFields
from riot_bus.chain.questions import UnitQuestions, draws_for, json_value
from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, MinimalRecord
from riot_bus.generalize.relevance import FieldSpace, Relevance, RelevantField, relevant_fields
from riot_bus.inject.brittle import why_brittle
from riot_bus.vocabulary.trial import Scalar, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun
    from riot_bus.sut.context import Context
    from riot_bus.sut.system import Unit

__all__ = ["considered_fields", "field_spaces", "relevance"]

_REPEATS = 3
_ROUNDS = 4
_STRAIGHT = 12
_INJECTED_PRIOR = 10.0


def considered_fields(fields: NamedFields, unit: Unit) -> list[NamedField]:
    """Return the fields that may be varied: all but the brittle ones and those that riot.toml leaves alone."""

    def wanted(field: NamedField) -> bool:
        name = f"{field.topic}:{field.leaf.path}"
        if field.original is not None or any(fnmatchcase(name, pattern) for pattern in unit.include):
            return True
        return not why_brittle(field.leaf.path, field.kind) and not any(
            fnmatchcase(name, pattern) for pattern in unit.leave
        )

    return [field for field in fields.fields.values() if wanted(field)]


def relevance(step: StepRun, folder: Path) -> FieldsRecord:
    """Find the relevant fields of `minimal.mcap` and write the certificates' logs.

    Each certificate's trials are repeated; an answer that its repetitions contradict is corrected, and the search done
    again with it (all other answers come from the store).

    Args:
        step: The running step.
        folder: The finding.

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: The minimal log does not fail again.
    """
    MinimalRecord.load(folder)
    context = step.workspace.context
    questions = UnitQuestions(step, folder)
    considered = considered_fields(questions.fields, context.file.unit[questions.finding.unit])
    spaces = field_spaces(questions, considered)

    def search() -> tuple[Relevance, tuple[FieldRecord, ...]]:
        found = relevant_fields(
            spaces,
            questions.ask,
            seed=step.workspace.seed,
            straight=_STRAIGHT,
            parallelism=questions.runner.parallelism,
            progress=step.progress,
        )
        return found, tuple(_confirmed(context, folder, one, questions) for one in found.fields)

    found, records = questions.settle(search, _contradicted, rounds=_ROUNDS)
    return FieldsRecord(
        fields=records,
        considered=tuple(field.name for field in considered),
        bound=min(1.0, found.bound),
        straight=found.straight,
    )


def field_spaces(questions: UnitQuestions, considered: Sequence[NamedField]) -> list[FieldSpace]:
    """Return fields with the values that may replace theirs."""
    observed = questions.nominal(considered)
    return [
        FieldSpace(
            field.name,
            field.leaf.value,
            field.original,
            draws_for(field, questions.dictionary, observed[field.name]),
            prior=1.0 if field.original is None else _INJECTED_PRIOR,
        )
        for field in considered
    ]


def _contradicted(
    searched: tuple[Relevance, Sequence[FieldRecord]],
) -> list[tuple[Mapping[str, Scalar], bool]]:
    """Return the questions that most of the repetitions of a certificate's trials answer otherwise, and that answer."""
    wrong: list[tuple[Mapping[str, Scalar], bool]] = []
    for one, record in zip(searched[0].fields, searched[1], strict=True):
        certificate = record.certificate
        if 2 * certificate.confirmed_failing < certificate.repeats:
            wrong.append((one.certificate.failing, False))
        if 2 * certificate.confirmed_passing < certificate.repeats:
            wrong.append((one.certificate.passing, True))
    return wrong


def _confirmed(context: Context, folder: Path, found: RelevantField, questions: UnitQuestions) -> FieldRecord:
    """Repeat both trials of a certificate with fresh processes and keep their logs."""
    logs, counts = [], []
    for side, values in (("failing", found.certificate.failing), ("passing", found.certificate.passing)):
        path = folder / "certificates" / f"{re.sub(r'[^A-Za-z0-9]+', '-', found.name).strip('-')}.{side}.mcap"
        path.parent.mkdir(exist_ok=True)
        metadata = {"finding": questions.finding.id, "field": found.name, "side": side}
        messages, originals = questions.fields.with_values(values), questions.fields.log.originals
        FailingLog(messages, originals).save(path, context=context, metadata=metadata)
        logs.append(str(path.relative_to(folder)))
        (outcomes,) = questions.repeat([values], range(1, _REPEATS + 1))
        if side == "failing":
            counts.append(sum(map(questions.failed, outcomes)))
        else:
            counts.append(sum(outcome.verdict is Verdict.PASS for outcome in outcomes))
    certificate = CertificateRecord(
        failing=json_value(found.certificate.failing[found.name]),
        passing=json_value(found.certificate.passing[found.name]),
        others={name: json_value(value) for name, value in found.certificate.failing.items() if name != found.name},
        failing_log=logs[0],
        passing_log=logs[1],
        confirmed_failing=counts[0],
        confirmed_passing=counts[1],
        repeats=_REPEATS,
    )
    leaf = questions.fields.fields[found.name].leaf
    return FieldRecord(
        name=found.name, kind=found.kind, type=leaf.type, failing=json_value(leaf.value), certificate=certificate
    )
