from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pytest

from riot_bus.generalize.oracle import BudgetSpentError, Trials, assignment_key, same_scalar, scalar_key
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.errors import InconclusiveError

RELIABLE = Noise.after(100, 100, nominal_total=100)


class System:
    """Answers questions, and keeps the batches in which they came."""

    def __init__(self, fails: Callable[[int], bool]) -> None:
        self.fails = fails
        self.batches: list[list[int]] = []

    def __call__(self, questions: Sequence[int]) -> list[bool]:
        self.batches.append(list(questions))
        return [self.fails(each) for each in questions]


def trials(system: System, *, budget: int = 1000, parallelism: int = 1, noise: Noise | None = RELIABLE) -> Trials[int]:
    return Trials(system, key=lambda question: question, noise=noise, budget=budget, parallelism=parallelism)


def test_keys_are_equal_for_identical_bits_only() -> None:
    assert same_scalar(math.nan, math.nan)
    assert not same_scalar(0.0, -0.0)
    assert not same_scalar(True, 1)
    assert not same_scalar(1, 1.0)
    assert not same_scalar("a", b"a")
    assert len({scalar_key(each) for each in (1, 1.0, True, "1", b"1")}) == 5
    assert assignment_key({"a": 1, "b": 2.0}) == assignment_key({"b": 2.0, "a": 1})
    assert assignment_key({"a": 1, "b": 2}) != assignment_key({"a": 2, "b": 1})


@pytest.mark.parametrize("rises", [True, False])
@pytest.mark.parametrize("parallelism", [1, 4])
def test_the_flip_is_found(rises: bool, parallelism: int) -> None:
    for flip in range(0, 64, 9):
        system = System(lambda at, flip=flip: (at >= flip) == rises)  # type: ignore[misc]
        asked = trials(system, parallelism=parallelism)
        found = asked.flip([1.0] * 64, lambda at: at, rises=rises, sure=0.95, doing="")
        assert found == flip
        assert asked.spent <= 30
        assert max(map(len, system.batches)) <= parallelism


def test_each_question_is_decided_and_equal_ones_together() -> None:
    system = System(lambda question: question > 2)
    asked = trials(system)
    assert asked.decide([1, 3, 2, 3, 1], doubt=0.01, doing="") == [False, True, False, True, False]
    assert asked.counts(3)[1] == asked.counts(1)[0] == 0
    assert sum(sum(asked.counts(each)) for each in (1, 2, 3)) == asked.spent
    assert asked.failed == asked.counts(3)[0]


def test_with_first_it_stops_at_the_first_that_triggers() -> None:
    system = System(lambda question: question == 1)
    chances = trials(system).triggers([0, 1, 2, 3, 4], prior=0.5, doubt=0.05, doing="", first=True)
    assert chances[1] > 0.95
    assert not {2, 3, 4} & {each for batch in system.batches for each in batch}


def test_a_sure_question_is_still_asked_as_often_as_demanded() -> None:
    system = System(lambda question: True)
    asked = trials(system)
    assert asked.triggers([7], prior=0.999, doubt=0.05, doing="", least=3)[0] > 0.95
    assert asked.counts(7) == (3, 0)
    asked.triggers([7], prior=0.999, doubt=0.05, doing="", least=3)  # earlier trials count
    assert asked.counts(7) == (3, 0)


def test_no_more_is_asked_than_the_budget_allows() -> None:
    system = System(lambda question: True)
    asked = trials(system, budget=5, parallelism=3)
    assert [len(asked.ask(list(range(9)), "")) for _ in range(2)] == [3, 2]
    with pytest.raises(BudgetSpentError):
        asked.ask([1], "")
    assert asked.spent == 5


def test_an_answer_must_come_for_each_question() -> None:
    asked: Trials[int] = Trials(lambda _: [True], key=str, noise=None, budget=9, parallelism=2)
    with pytest.raises(InconclusiveError, match="2 trials were asked for, but 1 outcomes came back"):
        asked.ask([1, 2], "")


def test_what_is_required_must_fail() -> None:
    asked = trials(System(lambda question: question == 1))
    asked.require(1, prior=0.5, doubt=0.05, doing="", what="the case", so="it ends")
    with pytest.raises(InconclusiveError, match=r"the case does not fail .* \(0 of \d trials\), so it ends"):
        asked.require(2, prior=0.5, doubt=0.05, doing="", what="the case", so="it ends")


def test_trials_teach_how_reliable_the_failure_is() -> None:
    answers = iter([True, False, False] * 200)
    asked = trials(System(lambda _: next(answers)), noise=Noise.after(nominal_total=100))
    before = asked.noise.rate
    asked.triggers([1], prior=0.98, doubt=1e-6, doing="", least=60)
    assert asked.noise.rate == pytest.approx(1 / 3, abs=0.1)
    assert before > 0.5


def test_progress_is_told_after_each_batch() -> None:
    told: list[tuple[int, int | None, str]] = []
    asked: Trials[int] = Trials(
        lambda questions: [True] * len(questions),
        key=str,
        noise=None,
        budget=9,
        parallelism=2,
        progress=lambda *each: told.append(each),
    )
    asked.ask([1, 2, 3], "minimizing")
    asked.ask([3], "checking")
    assert told == [(2, None, "minimizing"), (3, None, "checking")]
