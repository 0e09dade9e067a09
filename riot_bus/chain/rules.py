"""Step `rules`: the rule over the relevant fields that says when the unit fails (RIOT II-B c)."""

from __future__ import annotations

from statistics import pstdev
from typing import TYPE_CHECKING

from riot_bus.chain.questions import UnitQuestions, draws_for, json_value
from riot_bus.findings.records import AlternativeRecord, FieldsRecord, ProportionRecord, RuleRecord, RuleSample, Value
from riot_bus.generalize.rules import Estimate, LearnedRule, Sample, Variable, learn_rule
from riot_bus.generalize.sampling import TYPES, columns_of
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Scalar

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import StepRun

__all__ = ["rules"]

_NOMINAL = 200
_ROUNDS = 3
_ODD = 20
_CONTEXT = 64
"""So many other fields take other nominal values in some of the fresh trials."""


def rules(step: StepRun, folder: Path, *, budget: int = 160, validation: int = 60) -> RuleRecord:
    """Learn the rule.

    Samples that it gets wrong are asked again; an answer that two repetitions contradict is corrected.

    Args:
        step: The running step.
        folder: The finding.
        budget: Trials for learning.
        validation: Fresh trials for one validation.

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: No field is relevant, so there is nothing to make a rule of.
    """
    relevant = FieldsRecord.load(folder)
    if not relevant.fields:
        raise InconclusiveError(
            "no field of the minimal log is relevant, so there is no rule over fields",
            where=str(folder),
            hint="the failure depends on which messages arrive, not on their values; see minimal.mcap",
        )
    questions = UnitQuestions(step, folder)
    order = {name: place for place, name in enumerate(questions.fields.fields)}
    records = sorted(relevant.fields, key=lambda record: order[record.name])
    named = [questions.fields.fields[record.name] for record in records]
    observed = questions.nominal(named, at_most=_NOMINAL)
    variables = [
        Variable(
            field.name,
            field.leaf.type,
            field.leaf.value,
            passing=(_typed(record.certificate.passing, field.leaf.value),),
            nominal=tuple(([] if field.original is None else [field.original]) + observed[field.name]),
            dictionary=draws_for(field, questions.dictionary, ()),
        )
        for field, record in zip(named, records, strict=True)
    ]

    rest = (field for name, field in questions.fields.fields.items() if name not in observed)
    others = [field for field in rest if field.leaf.type in TYPES][:_CONTEXT]
    context = [
        Variable(field.name, field.leaf.type, field.leaf.value, nominal=tuple(values))
        for field, values in zip(others, questions.nominal(others, at_most=_NOMINAL).values(), strict=True)
    ]

    def search() -> LearnedRule:
        return learn_rule(
            variables,
            questions.ask,
            seed=step.workspace.seed,
            budget=budget,
            validation=validation,
            parallelism=questions.runner.parallelism,
            context=context,
            progress=step.progress,
        )

    def contradicted(learned: LearnedRule) -> list[tuple[Mapping[str, Scalar], bool]]:
        odd = _unexplained(learned, variables)
        wrong: list[tuple[Mapping[str, Scalar], bool]] = []
        for sample, outcomes in zip(odd, questions.repeat([one.assignment for one in odd], range(1, 3)), strict=True):
            second, third = map(questions.failed, outcomes)
            if second == third != sample.failed:
                wrong.append((sample.assignment, second))
        return wrong

    learned = questions.settle(search, contradicted, rounds=_ROUNDS)
    return _record(learned, {name: _spread(values) for name, values in observed.items()})


def _unexplained(learned: LearnedRule, variables: Sequence[Variable]) -> list[Sample]:
    """Return the few samples that the rule gets wrong: asked again, they may turn out differently."""
    samples = [one for one in learned.samples if one.phase != "context"]
    predicted = learned.rule.predict(columns_of(variables, [one.assignment for one in samples]))
    return [one for one, said in zip(samples, predicted, strict=True) if bool(said) != one.failed][:_ODD]


def _typed(value: Value, like: Scalar) -> Scalar:
    return bytes.fromhex(str(value)) if isinstance(like, bytes) else value


def _spread(values: Sequence[Scalar]) -> float:
    """Return the nominal spread of a field: the unit of the rule's distance."""
    numbers = [float(value) for value in values if isinstance(value, (bool, int, float))]
    return (pstdev(numbers) if len(numbers) > 1 else 0.0) or 1.0


def _proportion(one: Estimate) -> ProportionRecord:
    return ProportionRecord(
        value=0.0 if one.rate is None else one.rate, low=one.low, high=one.high, count=one.hits, total=one.total
    )


def _values(assignment: Mapping[str, Scalar]) -> dict[str, Value]:
    return {name: json_value(value) for name, value in assignment.items()}


def _record(learned: LearnedRule, scale: dict[str, float]) -> RuleRecord:
    return RuleRecord(
        text=learned.rule.text(),
        rule=learned.rule.to_dict(),
        python=learned.rule.python(),
        precision=_proportion(learned.precision),
        recall=_proportion(learned.recall),
        balanced_accuracy=learned.balanced_accuracy,
        checks=learned.checks,
        context_mistakes=learned.context_mistakes,
        context_checks=learned.context_checks,
        alternatives=tuple(
            AlternativeRecord(text=one.rule.text(), rule=one.rule.to_dict(), decided_by=_values(one.decided_by))
            for one in learned.alternatives
        ),
        scale=scale,
        samples=tuple(
            RuleSample(
                values=_values(sample.assignment),
                failed=sample.failed,
                phase=sample.phase,
            )
            for sample in learned.samples
        ),
    )
