from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.pool import runners
from riot_bus.pool.local import LocalRunner
from riot_bus.pool.runners import LocalRunners, slots_for
from riot_bus.trial.baseline import Baseline
from riot_bus.trial.context import open_system
from riot_bus.trial.hangs import KnownHangs
from riot_bus.vocabulary.message import Message
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
    [(0.0, 2), (0.01, 8), (0.3, 6), (0.5, 4), (0.55, 3), (0.9, 2), (1.0, 2), (7.5, 2)],
    ids=["unknown", "waits", "third", "half", "more than half", "most", "one", "many"],
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


def test_hangs_are_known_to_the_next_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "riot.toml"
    path.write_text('[components.part]\ncommand = ["true"]\ninputs = ["a"]\n[unit.u]\ncomponent = "part"\n')
    log = (Message(0, "a", b"1"),)
    monkeypatch.setattr(runners, "measure_baseline", lambda *_: Baseline(trials=3, log=log))
    context, known = open_system(path), KnownHangs(((("spin", "main"),),), 0.5)

    def at_begin_and_end(*, fresh: bool = False, finds: KnownHangs | None = None) -> KnownHangs | None:
        factory = LocalRunners(context, jobs=1, keep=tmp_path / "trials", fresh=fresh)
        factory.baseline("u", lambda: log)
        begin = factory._hangs.get("part")
        if finds is not None:
            factory._hangs["part"] = finds
        factory.close()
        return begin

    assert at_begin_and_end(finds=known) == KnownHangs()
    assert at_begin_and_end() == known
    assert at_begin_and_end(fresh=True, finds=KnownHangs()) is None
    assert at_begin_and_end(finds=KnownHangs((), 2.0)) == known
    assert at_begin_and_end() == KnownHangs((), 2.0)
