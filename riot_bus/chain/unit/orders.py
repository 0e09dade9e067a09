"""The order of two messages as a condition of a failure: swapped in trials, and checked in whole logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from riot_bus.chain.base.logs import NamedFields
from riot_bus.chain.unit.contexts import behind
from riot_bus.chain.unit.prediction import predict
from riot_bus.chain.unit.questions import UnitQuestions
from riot_bus.generalize.relevance import FieldSpace
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import LearnedRule
from riot_bus.generalize.sampling import Variable
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.order import order_of


def order_spaces(fields: NamedFields) -> list[FieldSpace]:
    """Return the orders of neighbouring messages as fields that may matter: as in the log, or swapped."""
    return [FieldSpace(name, failing=True, nominal=None, draws=(False,)) for name in fields.orders]


def order_variables(names: Iterable[str]) -> list[Variable]:
    """Return the orders among some names as variables of a rule."""
    return [Variable(name, "bool", failing=True, passing=(False,)) for name in names if order_of(name)]


def with_first(
    questions: UnitQuestions, learned: LearnedRule, variables: Sequence[Variable]
) -> tuple[LearnedRule, list[Variable]]:
    """Return the rule with `a before the first b` wherever a trial shows that an earlier b prevents the failure.

    The trial repeats the second message of the order in front of the minimal log.
    """
    words: dict[str, str] = {}
    failing = {variable.name: variable.failing for variable in variables}
    for name in learned.rule.variables:
        order = order_of(name)
        if order is not None:
            second = questions.fields.log.messages[questions.fields.orders[name] + 1]
            # stricter than usual: a wrong answer puts a wrong `first` into the rule
            (fails,) = questions.decide([behind(questions, (second,), failing)], doubt=0.02)
            if not fails:
                words[name] = str(order._replace(once=True))

    def other(row: Mapping[str, Any]) -> dict[str, Any]:
        return {words.get(name, name): value for name, value in row.items()}

    def renamed(rule: Rule) -> Rule:
        return rule.renamed(lambda name: words.get(name, name))

    told = replace(
        learned,
        rule=renamed(learned.rule),
        samples=tuple(replace(one, assignment=other(one.assignment)) for one in learned.samples),
        alternatives=tuple(
            replace(one, rule=renamed(one.rule), decided_by=other(one.decided_by)) for one in learned.alternatives
        ),
    )
    return told, [replace(one, name=words.get(one.name, one.name)) for one in variables]


def judge_of_logs(questions: UnitQuestions, rule: Rule) -> Callable[[Sequence[Message]], bool]:
    """Return a function that tells whether a rule holds anywhere in a log."""
    registry, topics = questions.fields.registry, questions.fields.topics
    return lambda messages: bool(predict(rule, topics, messages, registry=registry, at_most=1).fails)
