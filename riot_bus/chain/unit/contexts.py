"""Check of a rule from the minimal log: whether it holds after nominal messages, and which of them matter if not.

A unit keeps state from earlier messages: a mode, a size, a calibration. The minimal log sets only the state that the
failure needs, so a rule that is right on it may be wrong for the unit. Therefore some trials of the rule are repeated
after parts of the nominal log. If an outcome differs, the messages that cause this are searched as in minimisation;
with them in front, the rule can be learnt again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.chain.base.logs import FailingLog, NamedFields
from riot_bus.chain.unit.questions import UnitQuestions
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.rules import LearnedRule
from riot_bus.generalize.sampling import Variable, columns_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Progress, TestCase

_DOUBT, _SURE = 0.02, 0.002
"""Accepted doubts: few trials decide whether a rule holds for the unit, so those against it must be more certain."""
_LONGEST = 1000
"""Most nominal messages in front: a trial should stay about as cheap as one of the nominal log."""


@dataclass(frozen=True, slots=True)
class ContextAnswers:
    """Trials after nominal messages: the prediction of the rule for each, and whether the unit failed."""

    context: tuple[Message, ...]
    asked: tuple[Mapping[str, Setting], ...]
    predicted: tuple[bool, ...]
    failed: tuple[bool, ...]

    @property
    def wrong(self) -> list[int]:
        """Numbers of the trials that the rule predicts wrongly."""
        return [place for place, pair in enumerate(zip(self.predicted, self.failed, strict=True)) if pair[0] != pair[1]]


def contexts(nominal: Sequence[Message], registry: TypeRegistry) -> list[tuple[Message, ...]]:
    """Return the parts of the nominal log that trials follow: a short one and one up to its middle."""
    topics = [registry.topic(message.key) for message in nominal]
    first = {topic: place for place, topic in reversed(list(enumerate(topics)))}
    short = max(first.values(), default=-1) + 1
    lengths = dict.fromkeys(min(length, _LONGEST) for length in (short, max(short, len(nominal) // 2)))
    return [tuple(nominal[:length]) for length in lengths if length]


def _joined(context: Sequence[Message], messages: Sequence[Message]) -> tuple[Message, ...]:
    """Return a context and messages from a millisecond after its last one on, renumbered."""
    shift = context[-1].time + 1_000_000 - messages[0].time if context and messages else 0
    both = [*context, *(message.with_(time=message.time + shift) for message in messages)]
    return tuple(message.with_(sequence=place) for place, message in enumerate(both))


def near_the_limit(
    learned: LearnedRule, variables: Sequence[Variable], scale: Mapping[str, float], *, count: int
) -> tuple[list[Mapping[str, Setting]], list[bool]]:
    """Return trials that the rule predicts correctly, those nearest to and furthest from its limit, and predictions."""
    samples = [one for one in learned.samples if one.phase != "context"]
    columns = columns_of(variables, [one.assignment for one in samples])
    predicted, distance = learned.rule.predict(columns), np.abs(learned.rule.distance(columns, scale))
    chosen: list[int] = []
    for side in (True, False):
        alike = [n for n in np.argsort(distance, kind="stable") if predicted[n] == side == samples[n].failed]
        chosen += dict.fromkeys([*alike[: count - count // 2], *alike[len(alike) - count // 2 :]])
    return [samples[n].assignment for n in chosen], [bool(predicted[n]) for n in chosen]


def ask_in_contexts(
    questions: UnitQuestions,
    found: Sequence[tuple[Message, ...]],
    asked: Sequence[Mapping[str, Setting]],
    predicted: Sequence[bool],
    holds: Callable[[Sequence[Message]], bool],
    *,
    by_log: bool = False,
) -> list[ContextAnswers]:
    """Run trials after each context.

    Args:
        holds: Function that tells whether the rule holds anywhere in a log, such as already in the context.
        by_log: Whether this alone is the prediction, since the values do not decide it.
    """
    cases = [behind(questions, context, values) for context in found for values in asked]
    told = [holds(case.messages) for case in cases] if by_log else [*predicted] * len(found)
    failed = questions.decide(cases, doubt=_DOUBT)
    told = [one or (answer and holds(case.messages)) for one, answer, case in zip(told, failed, cases, strict=True)]
    against = [place for place, answer in enumerate(failed) if answer != told[place]]
    for place, answer in zip(against, questions.decide([cases[n] for n in against], doubt=_SURE), strict=True):
        failed[place] = answer
    return [
        ContextAnswers(context, tuple(asked), tuple(told[at : at + len(asked)]), tuple(failed[at : at + len(asked)]))
        for at, context in zip(range(0, len(cases), max(1, len(asked))), found, strict=True)
    ]


def bring_in(
    questions: UnitQuestions, answers: ContextAnswers, *, progress: Progress | None = None
) -> tuple[Message, ...]:
    """Return the few messages of a context that make the rule wrong; none if no part of it alone does so."""
    number = answers.wrong[0]
    values, failed = answers.asked[number], answers.failed[number]
    context = answers.context
    topics = [questions.fields.registry.topic(message.key) for message in context]

    def ask(parts: Sequence[tuple[int, ...]]) -> list[bool]:
        cases = [behind(questions, [context[place] for place in kept], values) for kept in parts]
        return [answer == failed for answer in questions.decide(cases, doubt=_DOUBT)]

    latest = {topic: place for place, topic in enumerate(topics)}
    weights = [10.0 if latest[topic] == place else 1.0 for place, topic in enumerate(topics)]
    kept = minimize(
        len(context), ask, weights=weights, groups=topics, parallelism=questions.runner.parallelism, progress=progress
    ).kept
    return tuple(context[place] for place in kept)


def with_context(questions: UnitQuestions, context: Sequence[Message], values: Mapping[str, Setting]) -> NamedFields:
    """Return the fields of a log with a context in front of the minimal log with these values."""
    fields = questions.fields
    changed = fields.with_values(values)
    messages = _joined(context, changed)
    originals = {
        after.sequence: fields.log.originals[before.sequence].with_(time=after.time, sequence=after.sequence)
        for before, after in zip(changed, messages[len(context) :], strict=True)
        if before.sequence in fields.log.originals
    }
    return NamedFields(FailingLog(messages, originals), registry=fields.registry)


def behind(questions: UnitQuestions, context: Sequence[Message], values: Mapping[str, Setting]) -> TestCase:
    """Return a test case of the minimal log, with values set by name, after other messages."""
    case = questions.case(values)
    messages = _joined(context, case.messages)
    several = len({message.key for message in messages}) > 1
    return replace(case, messages=messages, ordered=case.ordered or several)
