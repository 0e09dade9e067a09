"""Step `rules`: the rule over the relevant fields that says when the unit fails (RIOT II-B c)."""

from __future__ import annotations

from statistics import pstdev
from typing import TYPE_CHECKING

from riot_bus.chain.logs import FailingLog, NamedFields, nominal_values
from riot_bus.chain.relevance import draws_for, plain
from riot_bus.chain.robustness import dictionary_of
from riot_bus.findings.records import FieldsRecord, FindingRecord, ProportionRecord, RuleRecord, RuleSample, Value
from riot_bus.generalize.rules import LearnedRule, Proportion, Sample, Variable, learn_rule
from riot_bus.generalize.sampling import columns_of
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Scalar, TestCase

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import Step, Workspace

__all__ = ["rules"]

_NOMINAL = 200
_ROUNDS = 3
_ODD = 20


def rules(workspace: Workspace, folder: Path, *, budget: int = 160, validation: int = 60) -> RuleRecord:
    """Learn the rule and write `rule.json`.

    Args:
        workspace: Where to work.
        folder: The finding.
        budget: Trials for learning.
        validation: Fresh trials for one validation.

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: No field is relevant, so there is nothing to make a rule of.
    """
    finding, relevant = FindingRecord.load(folder), FieldsRecord.load(folder)
    if not relevant.fields:
        raise InconclusiveError(
            "no field of the minimal log is relevant, so there is no rule over fields",
            where=str(folder),
            hint="the failure depends on which messages arrive, not on their values; see minimal.mcap",
        )
    registry = workspace.context.registry
    fields = NamedFields(FailingLog.load(folder / "minimal.mcap", registry=registry), registry=registry)
    order = {name: place for place, name in enumerate(fields.fields)}
    records = sorted(relevant.fields, key=lambda record: order[record.name])
    named = [fields.fields[record.name] for record in records]
    paths: dict[str, set[str]] = {}
    for field in named:
        paths.setdefault(field.topic, set()).add(field.leaf.path)
    nominal = nominal_values(workspace.unit_log(finding.unit), paths, registry=registry, at_most=_NOMINAL)
    observed = {field.name: nominal[f"{field.topic}:{field.leaf.path}"] for field in named}
    dictionary = dictionary_of(workspace, finding.unit)
    variables = [
        Variable(
            field.name,
            field.leaf.type,
            field.leaf.value,
            passing=(_typed(record.certificate.passing, field.leaf.value),),
            nominal=tuple(([] if field.original is None else [field.original]) + observed[field.name]),
            dictionary=draws_for(field, dictionary, ()),
        )
        for field, record in zip(named, records, strict=True)
    ]
    with workspace.step("rules") as step:
        runner = step.unit_runner(finding.unit)

        corrected: dict[str, bool] = {}

        def answers(questions: Sequence[Mapping[str, Scalar]], again: int = 0) -> list[tuple[str, bool]]:
            cases = [TestCase(fields.with_values(values), seed=workspace.seed + again) for values in questions]
            outcomes = runner.run(cases)
            return [(one.digest(), out.failed_as(finding.signature)) for one, out in zip(cases, outcomes, strict=True)]

        def ask(questions: Sequence[Mapping[str, Scalar]]) -> list[bool]:
            return [corrected.get(digest, failed) for digest, failed in answers(questions)]

        for _ in range(_ROUNDS):
            learned = learn_rule(
                variables,
                ask,
                seed=workspace.seed,
                budget=budget,
                validation=validation,
                parallelism=runner.parallelism,
                progress=step.progress,
            )
            odd = _unexplained(learned, variables)
            votes = [answers([one.assignment for one in odd], again) for again in range(3)]
            wrong = {
                digest: not sample.failed
                for sample, (digest, _), (_, second), (_, third) in zip(odd, *votes, strict=True)
                if second == third != sample.failed
            }
            if not wrong:
                break
            corrected.update(wrong)
        record = _record(learned, {name: _spread(values) for name, values in observed.items()}, step)
        record.save(folder)
        workspace.narrator.end(
            "rules",
            f"fails when {record.text} (balanced accuracy {record.balanced_accuracy:.3f} on "
            f"{record.precision.total + record.recall.total} fresh checks, {step.trials} trials)",
        )
    return record


def _unexplained(learned: LearnedRule, variables: Sequence[Variable]) -> list[Sample]:
    """Return the few samples that the rule gets wrong: asked again, they may turn out differently."""
    predicted = learned.rule.predict(columns_of(variables, [one.assignment for one in learned.samples]))
    return [one for one, said in zip(learned.samples, predicted, strict=True) if bool(said) != one.failed][:_ODD]


def _typed(value: Value, like: Scalar) -> Scalar:
    return bytes.fromhex(str(value)) if isinstance(like, bytes) else value


def _spread(values: Sequence[Scalar]) -> float:
    """Return the nominal spread of a field: the unit of the rule's distance."""
    numbers = [float(value) for value in values if isinstance(value, (bool, int, float))]
    return (pstdev(numbers) if len(numbers) > 1 else 0.0) or 1.0


def _proportion(one: Proportion) -> ProportionRecord:
    return ProportionRecord(value=one.rate, low=one.low, high=one.high, count=one.hits, total=one.total)


def _record(learned: LearnedRule, scale: dict[str, float], step: Step) -> RuleRecord:
    return RuleRecord(
        text=learned.rule.text(),
        rule=learned.rule.to_dict(),
        python=learned.rule.python(),
        precision=_proportion(learned.precision),
        recall=_proportion(learned.recall),
        balanced_accuracy=learned.balanced_accuracy,
        scale=scale,
        samples=tuple(
            RuleSample(
                values={name: plain(value) for name, value in sample.assignment.items()},
                failed=sample.failed,
                phase=sample.phase,
            )
            for sample in learned.samples
        ),
        seed=step.workspace.seed,
        trials=step.trials,
        seconds=step.seconds,
    )
