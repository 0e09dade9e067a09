from __future__ import annotations

import pytest

from riot_bus.sut.local import LocalRunner
from riot_bus.sut.runners import slots_for
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict


class _Pool:
    """Executes nothing; keeps how many trials may run at once."""

    jobs = 2

    def __init__(self) -> None:
        self.most: list[int] = []

    def map(self, trial, cases, ended, *, into, most):
        self.most.append(most)
        return [Outcome(Verdict.PASS, seconds=2.0, statistics={"busy": 0.5}) for _ in cases]


@pytest.mark.parametrize(
    ("busy", "slots"),
    [(0.0, 2), (0.01, 8), (0.3, 6), (0.5, 4), (0.99, 2), (1.0, 2), (7.5, 2)],
    ids=["unknown", "waits", "third", "half", "most", "one", "many"],
)
def test_trials_that_wait_share_processors_and_none_stays_without(busy: float, slots: int) -> None:
    assert slots_for(busy, 2) == slots


def test_as_many_run_at_once_as_those_before_have_left_room_for() -> None:
    pool = _Pool()
    runner = LocalRunner(lambda: None, pool, lambda busy: slots_for(busy, 2), batch=6)
    assert runner.parallelism == 6
    runner.run([TestCase(seed=number) for number in range(6)])
    runner.run([TestCase(seed=number) for number in range(6)])
    runner.run([TestCase()])
    assert pool.most == [0, 4, 0]
    assert LocalRunner(lambda: None, pool, lambda _: 2).parallelism == 2
