"""Worker processes that die lose nothing and count nothing twice; a case that kills them is an outcome of its own."""

from __future__ import annotations

import errno
import random
import threading
from collections import Counter
from concurrent.futures import CancelledError
from pathlib import Path

import psutil
import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from riot_bus.zenoh.session import wait_until
from tests.systems.misbehaviour.catalogue import write
from tests.tiers import scaled

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

UNIT = UnitTrial("echoes")


def workers(folder: Path) -> list[psutil.Process]:
    """Return the worker processes of the system in a folder."""
    mine = psutil.Process().children()
    return [each for each in mine if str(folder / "riot.toml") in each.cmdline()]


def log_of(path: Path) -> tuple[Message, ...]:
    with Workspace(path, path.parent / "out") as workspace:
        return workspace.unit_log("echoes")


def test_workers_killed_at_random_moments_lose_nothing_and_count_nothing_twice(tmp_path: Path) -> None:
    path, rest = write(tmp_path), random.Random(str(tmp_path))
    cases = [TestCase(log_of(path), seed=number) for number in range(scaled(160, gate=40))]
    kills = scaled(20, gate=4)
    times, over = Counter[int](), threading.Event()
    killed = 0

    def kill() -> None:
        """Kill the oldest worker each time, so that no case costs three."""
        nonlocal killed
        for _ in range(kills):
            more = times.total() + 2
            wait_until(lambda: over.is_set() or times.total() >= more, 120)  # noqa: B023
            if over.wait(rest.uniform(0.0, 0.1)):  # within the next trials or between them
                return
            min(workers(tmp_path), key=psutil.Process.create_time).kill()
            killed += 1

    def ended(number: int, outcome: Outcome) -> None:
        times[number] += outcome.verdict is Verdict.PASS

    killer = threading.Thread(target=kill)
    with Pool(path, 2, keep=tmp_path / "trials") as pool:
        killer.start()
        outcomes = pool.map(UNIT, cases, ended)
        over.set()
        killer.join()
    assert killed == kills
    assert [each.verdict for each in outcomes] == [Verdict.PASS] * len(cases)
    assert times == dict.fromkeys(range(len(cases)), 1)
    assert not workers(tmp_path)
    assert not [*(tmp_path / "trials").iterdir()]


def test_more_trials_than_jobs_run_at_once_where_that_is_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path)
    with Pool(path, 1, keep=tmp_path / "trials") as pool:
        cases = [TestCase(seed=number) for number in range(4)]
        assert {each.verdict for each in pool.map(IdleTrial("echoes"), cases)} == {Verdict.PASS}
        assert len(workers(tmp_path)) == 1
        outcomes = pool.map(IdleTrial("echoes"), cases, most=3)
        assert len(workers(tmp_path)) == 3
    assert all(0 < one.statistics["busy"] < 2 for one in outcomes)


KILLS = """
import os
class Kills:
    def judge(self, view):
        os.kill(os.getpid(), 9)
"""


def test_a_case_that_kills_its_worker_three_times_is_an_outcome_of_its_own(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "kills.py").write_text(KILLS)
    with path.open("a") as stream:
        stream.write('[[monitors]]\nkind = "kills.py"\n')
    with Pool(path, 1, keep=tmp_path / "trials") as pool:
        outcome = pool.execute(UNIT, TestCase(log_of(path)))
        assert outcome.verdict is Verdict.UNJUDGED
        assert "3 processes that executed it have ended one after the other, the last one with signal 9" in (
            outcome.detail
        )
        assert pool.execute(IdleTrial("echoes"), TestCase()).verdict is Verdict.PASS


def test_what_a_trial_or_a_listener_raises_is_raised_where_the_outcome_is_awaited(tmp_path: Path) -> None:
    path = write(tmp_path)

    def full(_: int, outcome: Outcome) -> None:
        raise OSError(errno.ENOSPC, "full")

    with Pool(path, 1, keep=tmp_path / "trials") as pool:
        with pytest.raises(OSError, match="full"):
            pool.map(IdleTrial("echoes"), [TestCase()], full)
        path.write_text(path.read_text().replace("[components.echoes]\n", '[components.echoes]\nsegment = "else"\n'))
        with Pool(path, 1, keep=tmp_path / "trials") as other, pytest.raises(ConfigError, match="else"):
            other.execute(SystemTrial(RunPace(duration=1.0)), TestCase())
        assert pool.map(IdleTrial("echoes"), []) == []


def test_closing_the_pool_ends_what_runs_and_touches_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, here = write(tmp_path), tmp_path / "here"
    here.mkdir()
    (here / "file").touch()
    monkeypatch.chdir(here)
    ends: list[int] = []
    pool = Pool(path, 2, keep=tmp_path / "trials")
    cases = [TestCase(log_of(path), seed=number) for number in range(50)]

    def ask() -> None:
        with pytest.raises(CancelledError):
            pool.map(UNIT, cases, lambda number, _: ends.append(number))

    asking = threading.Thread(target=ask)
    asking.start()
    assert wait_until(lambda: len(ends) > 1, 60)
    below = [each for worker in workers(tmp_path) for each in worker.children(recursive=True)]
    assert below
    pool.close()
    told = len(ends)
    asking.join(10)
    assert not asking.is_alive()
    assert not workers(tmp_path)
    assert not psutil.wait_procs(below, timeout=10)[1]
    assert not [*(tmp_path / "trials").iterdir()]
    assert [*here.iterdir()] == [here / "file"]
    assert len(ends) == told < len(cases)
    with pytest.raises(RuntimeError, match="closed"):
        pool.execute(UNIT, cases[0])
