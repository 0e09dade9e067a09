"""Step `rules`: the rule over the relevant fields that says when the unit fails (RIOT II-B c)."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import pstdev

from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.steps.relevance import considered_fields, field_spaces
from riot_bus.chain.unit.arrays import with_arrays
from riot_bus.chain.unit.contexts import (
    ContextAnswers,
    ask_in_contexts,
    bring_in,
    contexts,
    near_the_limit,
    with_context,
)
from riot_bus.chain.unit.forms import with_forms
from riot_bus.chain.unit.legend import legend_of
from riot_bus.chain.unit.orders import judge_of_logs, order_variables, with_first
from riot_bus.chain.unit.prediction import explained, rule_text
from riot_bus.chain.unit.questions import UnitQuestions, draws_for, json_value
from riot_bus.findings.records import AlternativeRecord, FieldsRecord, ProportionRecord, RuleRecord, RuleSample, Value
from riot_bus.generalize.relevance import relevant_fields
from riot_bus.generalize.rules import LearnedRule, learn_rule
from riot_bus.generalize.sampling import TYPES, Variable, columns_of, row_of, scalars_of
from riot_bus.generalize.validation import Estimate
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.order import order_of

_NOMINAL = 200  # of the values of a field: a guess at how many show its nominal spread


def rules(step: StepRun, folder: Path, *, budget: int = 160, validation: int = 60) -> RuleRecord:
    """Learn the rule.

    Each answer is decided by as many fresh trials as it takes; those that the rule gets wrong, or depends on, by more.

    Raises:
        ConfigError: The step before has not been done.
        InconclusiveError: No field is relevant, so there is nothing to make a rule from.
    """
    relevant = FieldsRecord.load(folder)
    if not relevant.fields and relevant.unconfirmed:
        raise InconclusiveError(
            f"fresh trials did not confirm that {', '.join(relevant.unconfirmed)} is relevant, and no other field is",
            where=str(folder),
            hint="the failure may come more seldom than it seemed; `riot analyze --seed N --out FOLDER` begins anew",
        )
    if not relevant.fields:
        raise InconclusiveError(
            "no field of the minimal log is relevant, so there is no rule over fields",
            where=str(folder),
            hint="the failure depends on which messages and keys arrive, or in which order; see `riot show`",
        )
    teacher = _Teacher(step, budget, validation)
    passing = {one.name: one.certificate.passing for one in relevant.fields}
    questions = UnitQuestions(step, folder)
    questions.measure(one.certificate for one in relevant.fields)
    found = teacher.learn(questions, passing)
    for _ in range(2):  # once for a size, once for a mode beside it
        more = teacher.learn_after_context(found) if found.wrong else None
        if more is None or more.wrong >= found.wrong:
            break
        found = more
    (folder / "context.mcap").unlink(missing_ok=True)  # of an earlier rule
    finding, record = found.questions.finding, _record(found)
    if found.context:
        log, metadata = found.questions.fields.log, finding.provenance
        log.save(folder / "context.mcap", context=step.workspace.context, metadata=metadata)
    campaign = explained(record, step, finding.unit, finding.signature, rate=found.questions.noise.rate)
    figures = {
        "in_campaign": ProportionRecord.of(proportion(campaign.trials - len(campaign.wrong), campaign.trials)),
        "missed": sum(failed for _, failed in campaign.wrong),
        "held": campaign.holds,
        "unjudged": campaign.unknown,
        "keeps": campaign.keeps,
    }
    return with_forms(record.model_copy(update=figures), finding, folder)


@dataclass(frozen=True, slots=True)
class _Found:
    """A rule with what it was learnt from."""

    questions: UnitQuestions
    passing: Mapping[str, Value]
    variables: Sequence[Variable]
    scale: dict[str, float]
    learned: LearnedRule
    answers: Sequence[ContextAnswers]
    context: int = 0

    @property
    def wrong(self) -> int:
        """Number of answers that the rule predicts wrongly."""
        return sum(len(one.wrong) for one in self.answers)


@dataclass(frozen=True, slots=True)
class _Teacher:
    """Learns a rule on the minimal log, and again with nominal messages in front of it that matter."""

    step: StepRun
    budget: int
    validation: int

    def learn(self, questions: UnitQuestions, passing: Mapping[str, Value], *, context: int = 0) -> _Found:
        """Learn the rule over some fields."""
        named = [field for field in questions.fields.fields.values() if field.name in passing]
        named.sort(key=lambda field: -field.position)  # people say how a message differs from what came before it
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
        variables = [*with_arrays(questions, named, variables), *order_variables(passing)]

        unit = self.step.workspace.context.file.unit[questions.finding.unit]
        rest = (field for field in considered_fields(questions.fields, unit) if field.name not in observed)
        others = [field for field in rest if field.leaf.type in TYPES][:64]
        varied = [
            Variable(field.name, field.leaf.type, field.leaf.value, nominal=tuple(values))
            for field, values in zip(others, questions.nominal(others, at_most=_NOMINAL).values(), strict=True)
        ]
        scale = _scale(variables, observed)
        share = 0.5 if questions.noise.rate < 0.6 else 1.0  # fewer checks where each answer takes many trials
        learned = learn_rule(
            variables,
            questions.ask,
            expecting=questions.ask,
            seed=self.step.workspace.seed,
            budget=self.budget,
            validation=round(self.validation * share),
            parallelism=questions.runner.parallelism,
            context=varied,
            progress=self.step.progress,
        )
        learned, variables = with_first(questions, learned, variables)
        scale = _scale(variables, observed)
        asked, predicted = near_the_limit(learned, variables, scale, count=round(6 * share))
        behind, holds = (
            contexts(questions.nominal_log(), questions.fields.registry),
            judge_of_logs(questions, learned.rule),
        )
        by_log = any(order_of(name) for name in learned.rule.variables)
        answers = ask_in_contexts(questions, behind, asked, predicted, holds, by_log=by_log)
        return _Found(questions, passing, variables, scale, learned, answers, context)

    def learn_after_context(self, found: _Found) -> _Found | None:
        """Learn the rule again on the minimal log with those nominal messages before it after which it is wrong.

        They are a few messages of that part of the nominal log after which the rule predicts the most trials wrongly.

        Returns:
            The new rule, with what it was learnt from; None if no such messages are found, an order of messages in the
            rule does not exist in the longer log, or the trials are inconclusive.
        """
        wrong = max(found.answers, key=lambda one: len(one.wrong))
        failing = next((values for values, failed in zip(wrong.asked, wrong.failed, strict=True) if failed), None)
        if failing is None:
            return None
        try:
            return self._after_context(found, bring_in(found.questions, wrong, progress=self.step.progress), failing)
        except InconclusiveError:  # this casts no doubt on what the rule was learnt from
            return None

    def _after_context(
        self, found: _Found, context: Sequence[Message], failing: Mapping[str, Setting]
    ) -> _Found | None:
        if not context:
            return None
        fields = with_context(found.questions, context, failing)
        questions = found.questions.within(fields)
        passing: dict[str, Value] = {}
        for name, value in found.passing.items():
            if order_of(name):
                if name not in fields.orders:
                    return None
                passing[name] = value
                continue
            old = found.questions.fields.fields[name]
            new = next(
                one
                for one in fields.fields.values()
                if (one.position, one.leaf.path) == (old.position + len(context), old.leaf.path)
            )
            passing[new.name] = value
        unit = self.step.workspace.context.file.unit[questions.finding.unit]
        considered = [
            field for field in considered_fields(fields, unit) if field.name in passing or field.position < len(context)
        ]
        relevant = relevant_fields(
            field_spaces(questions, considered),
            questions.fresh(),
            seed=self.step.workspace.seed,
            noise=questions.noise,
            parallelism=questions.runner.parallelism,
            progress=self.step.progress,
        )
        known = len(passing)
        for one in relevant.fields:
            passing.setdefault(one.name, json_value(one.certificate.passing[one.name]))
        if len(passing) == known:
            return None
        return self.learn(questions, passing, context=found.context + len(context))


def _typed(value: Value, like: Scalar) -> Scalar:
    return bytes.fromhex(str(value)) if isinstance(like, bytes) else value


def _scale(variables: Sequence[Variable], observed: Mapping[str, Sequence[Scalar]]) -> dict[str, float]:
    """Return the nominal spread of each variable as rules see them."""
    return {one.name: _spread(observed.get(one.name, one.nominal)) for one in scalars_of(variables)}


def _spread(values: Sequence[Setting]) -> float:
    """Return the nominal spread of a field: the unit of the rule's distance."""
    numbers = [float(value) for value in values if isinstance(value, (bool, int, float))]
    return (pstdev(numbers) if len(numbers) > 1 else 0.0) or 1.0


def _estimated(one: Estimate) -> ProportionRecord:
    return ProportionRecord(value=one.rate or 0.0, low=one.low, high=one.high, count=one.hits, total=one.total)


def _values(row: Mapping[str, Scalar], told: Container[str]) -> dict[str, Value]:
    return {name: json_value(value) for name, value in row.items() if name in told}


def _record(found: _Found) -> RuleRecord:
    learned = found.learned
    topics = found.questions.fields.topics

    asked = sum(len(one.asked) for one in found.answers)
    rules = [learned.rule, *(one.rule for one in learned.alternatives)]
    # variables of an array that no rule uses are left out
    told = {one.name for one in found.variables}.union(*(rule.variables for rule in rules))
    types = {one.name: one.type for one in scalars_of(found.variables) if one.name in told}
    rows = [row_of(found.variables, sample.assignment) for sample in learned.samples]
    said = learned.rule.predict(columns_of(found.variables, [sample.assignment for sample in learned.samples]))
    wrong = [
        row
        for row, sample, says in zip(rows, learned.samples, said, strict=True)
        if says != sample.failed and sample.phase != "context"
    ]
    return RuleRecord(
        text=rule_text(learned.rule, topics),
        rule=learned.rule.to_dict(),
        legend=legend_of(learned.rule, found.questions.fields.fields, topics),
        precision=_estimated(learned.precision),
        recall=_estimated(learned.recall),
        balanced_accuracy=learned.balanced_accuracy,
        checks=learned.checks,
        varied_mistakes=learned.varied_mistakes,
        varied_checks=learned.varied_checks,
        alternatives=tuple(
            AlternativeRecord(
                text=rule_text(one.rule, topics), rule=one.rule.to_dict(), decided_by=_values(one.decided_by, types)
            )
            for one in learned.alternatives
        ),
        in_context=ProportionRecord.of(proportion(asked - found.wrong, asked)),
        topics=tuple(topics),
        context=tuple(topics[: found.context]),
        scale={name: spread for name, spread in found.scale.items() if name in types},
        types=types,
        own_mistakes=len(wrong),
        own_mistake=_values(wrong[0], learned.rule.variables) if wrong else {},
        samples=tuple(
            RuleSample(values=_values(row, types), failed=sample.failed, phase=sample.phase)
            for row, sample in zip(rows, learned.samples, strict=True)
        ),
    )
