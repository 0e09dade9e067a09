from __future__ import annotations

import pytest

from riot_bus.generalize.questions import Questions
from riot_bus.generalize.sampling import Variable
from riot_bus.vocabulary.errors import InconclusiveError

X = Variable("x", "int8", 100, nominal=(1, 2))


def questions(ask=lambda some: [one["x"] > 50 for one in some], expecting=None, budget=10):
    told = []
    found = Questions([X], ask, expecting, lambda done, phase: told.append((done, phase)), budget=budget, parallelism=2)
    return found, told


def test_nothing_is_asked_twice_or_beyond_the_budget():
    asking, told = questions(budget=3)
    assert asking.ask([{"x": 100}], "start")[0].failed
    assert [one.failed for one in asking.ask([{"x": 100}, {"x": 1}, {"x": 1}], "start")] == [False]
    assert [one.assignment for one in asking.ask([{"x": 1}, {"x": 2}, {"x": 3}], "start")] == [{"x": 2}]
    assert (asking.spent, asking.trials) == (3, 3)
    assert told[-1] == (3, "start")
    assert asking.known({"x": 2})
    assert not asking.known({"x": 3})


def test_validation_is_on_top_of_the_budget_and_context_teaches_nothing():
    asking, _ = questions(budget=0)
    assert not asking.ask([{"x": 1}], "explore")
    assert len(asking.ask([{"x": 1}], "validate")) == 1
    assert len(asking.ask([{"x": 2}], "context")) == 1
    assert asking.table.assignments == [{"x": 1}]
    assert asking.mistakes(asking.samples) == 0


def test_each_question_needs_an_answer():
    asking, _ = questions(ask=lambda some: [])
    with pytest.raises(InconclusiveError, match="1 trials were asked for"):
        asking.ask([{"x": 1}], "start")


def test_without_rule_answers_are_not_expected_but_the_first():
    expected = []

    def expecting(some, chances):
        expected.extend(chances)
        return [one["x"] > 50 for one in some]

    asking, _ = questions(expecting=expecting)
    asking.ask([{"x": 100}], "start")
    asking.ask([{"x": 1}, {"x": 2}], "explore")
    assert expected == [0.98, 0.5, 0.5]
    assert not asking.settle()
