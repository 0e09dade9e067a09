"""Step `rules`: the rule over the relevant fields that says when the unit fails (RIOT II-B c)."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import pstdev
from typing import TYPE_CHECKING

from riot_bus.chain.contexts import ask_in_contexts, bring_in, contexts, near_the_limit, with_context
from riot_bus.chain.prediction import explained
from riot_bus.chain.questions import UnitQuestions, draws_for, json_value
from riot_bus.chain.relevance import considered_fields, field_spaces
from riot_bus.findings.records import FieldsRecord, ProportionRecord, RuleRecord, RuleSample, Value
from riot_bus.generalize.relevance import relevant_fields
from riot_bus.generalize.rules import LearnedRule, Proportion, Sample, Variable, learn_rule
from riot_bus.generalize.sampling import columns_of
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Scalar

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.chain.contexts import ContextAnswers
    from riot_bus.chain.workspace import StepRun

__all__ = ["rules"]

_NOMINAL = 200
_ROUNDS = 3
_ODD = 20
_NEAR = 6
"""So many trials that fail, and as many that pass, are asked again behind each part of the nominal log."""
_CONTEXTS = 2
"""So many times at most messages are put in front: one for a size, one for a mode beside it."""


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
    teacher = _Teacher(step, budget, validation)
    passing = {one.name: one.certificate.passing for one in relevant.fields}
    found = teacher.learn(UnitQuestions(step, folder), passing)
    for _ in range(_CONTEXTS):
        worst = max(found.answers, key=lambda one: len(one.wrong), default=None)
        if worst is None or not worst.wrong or (more := teacher.learn_behind(found, worst)) is None:
            break
        found = more
    if found.context:
        metadata = {"finding": found.questions.finding.id, "signature": found.questions.finding.signature}
        found.questions.fields.log.save(folder / "context.mcap", context=step.workspace.context, metadata=metadata)
    record = _record(found)
    finding = found.questions.finding
    trials, wrong = explained(record, step, finding.unit, finding.signature)
    missed = sum(failed for _, failed in wrong)
    rate = _proportion(proportion(trials - len(wrong), trials))
    return record.model_copy(update={"in_campaign": rate, "missed": missed})


@dataclass(frozen=True, slots=True)
class _Found:
    """A rule with what it was learnt from.

    Attributes:
        questions: Ask the unit with the log in which the rule's fields are named.
        variables: The fields.
        scale: Their nominal spread.
        learned: The rule.
        answers: Some of its trials, asked again behind nominal messages.
        context: How many messages in front of the minimal log matter.
    """

    questions: UnitQuestions
    variables: Sequence[Variable]
    scale: dict[str, float]
    learned: LearnedRule
    answers: Sequence[ContextAnswers]
    context: int = 0


class _Teacher:
    """Learns a rule on the minimal log, and again with nominal messages in front of it that matter."""

    def __init__(self, step: StepRun, budget: int, validation: int) -> None:
        self.step = step
        self.budget = budget
        self.validation = validation
        self._registry = step.workspace.context.registry

    def learn(self, questions: UnitQuestions, passing: Mapping[str, Value], *, context: int = 0) -> _Found:
        """Learn the rule over some fields; samples that it gets wrong are asked again."""
        named = [field for field in questions.fields.fields.values() if field.name in passing]
        observed = questions.nominal(named, at_most=_NOMINAL)
        variables = [
            Variable(
                field.name,
                field.leaf.type,
                field.leaf.value,
                passing=(_typed(passing[field.name], field.leaf.value),),
                nominal=tuple(([] if field.original is None else [field.original]) + observed[field.name]),
                dictionary=draws_for(field, questions.dictionary, ()),
            )
            for field in named
        ]

        def search() -> LearnedRule:
            return learn_rule(
                variables,
                questions.ask,
                seed=self.step.workspace.seed,
                budget=self.budget,
                validation=self.validation,
                parallelism=questions.runner.parallelism,
                progress=self.step.progress,
            )

        def contradicted(learned: LearnedRule) -> list[tuple[Mapping[str, Scalar], bool]]:
            odd = _unexplained(learned, variables)
            repeated = questions.repeat([one.assignment for one in odd], range(1, 3))
            wrong: list[tuple[Mapping[str, Scalar], bool]] = []
            for sample, outcomes in zip(odd, repeated, strict=True):
                second, third = map(questions.failed, outcomes)
                if second == third != sample.failed:
                    wrong.append((sample.assignment, second))
            return wrong

        learned = questions.settle(search, contradicted, rounds=_ROUNDS)
        scale = {name: _spread(values) for name, values in observed.items()}
        asked, predicted = near_the_limit(learned, variables, scale, count=_NEAR)
        answers = ask_in_contexts(questions, contexts(questions.nominal_log(), self._registry), asked, predicted)
        return _Found(questions, variables, scale, learned, answers, context)

    def learn_behind(self, found: _Found, wrong: ContextAnswers) -> _Found | None:
        """Learn the rule again with the nominal messages in front that make it wrong; None if they cannot be told."""
        failing = next((values for values, failed in zip(wrong.asked, wrong.failed, strict=True) if failed), None)
        context = bring_in(found.questions, wrong, progress=self.step.progress) if failing else ()
        if not context or failing is None:
            return None
        fields = with_context(found.questions, context, failing)
        questions = found.questions.within(fields)
        passing: dict[str, Value] = {}
        for variable in found.variables:
            old = found.questions.fields.fields[variable.name]
            new = next(
                one
                for one in fields.fields.values()
                if (one.position, one.leaf.path) == (old.position + len(context), old.leaf.path)
            )
            passing[new.name] = json_value(variable.passing[0])
        unit = self.step.workspace.context.file.unit[questions.finding.unit]
        considered = [
            field for field in considered_fields(fields, unit) if field.name in passing or field.position < len(context)
        ]
        relevant = relevant_fields(
            field_spaces(questions, considered),
            questions.ask,
            seed=self.step.workspace.seed,
            parallelism=questions.runner.parallelism,
            progress=self.step.progress,
        )
        known = len(passing)
        for one in relevant.fields:
            passing.setdefault(one.name, json_value(one.certificate.passing[one.name]))
        if len(passing) == known:
            return None
        return self.learn(questions, passing, context=found.context + len(context))


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


def _record(found: _Found) -> RuleRecord:
    learned = found.learned
    topics = [found.questions.fields.registry.topic(message.key) for message in found.questions.fields.log.messages]
    wrong = sum(len(one.wrong) for one in found.answers)
    asked = sum(len(one.asked) for one in found.answers)
    return RuleRecord(
        text=learned.rule.text(),
        rule=learned.rule.to_dict(),
        python=learned.rule.python(),
        precision=_proportion(learned.precision),
        recall=_proportion(learned.recall),
        balanced_accuracy=learned.balanced_accuracy,
        checks=learned.checks,
        in_context=_proportion(proportion(asked - wrong, asked)),
        topics=tuple(topics),
        context=tuple(topics[: found.context]),
        scale=found.scale,
        samples=tuple(
            RuleSample(
                values={name: json_value(value) for name, value in sample.assignment.items()},
                failed=sample.failed,
                phase=sample.phase,
            )
            for sample in learned.samples
        ),
    )
