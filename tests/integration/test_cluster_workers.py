"""Trials on two workers of Dask on loopback: those of the local pool, whatever is killed."""

from __future__ import annotations

import shutil
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import psutil
import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.pool.local import Pool
from riot_bus.trial.context import open_system
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from riot_bus.zenoh.session import wait_until
from riot_bus_cluster.workers import ClusterWorkers
from tests.dask_cluster import DaskCluster
from tests.systems.misbehaviour.catalogue import write

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write(tmp_path_factory.mktemp("system"))
    head = "[components.echoes]\n"
    text = path.read_text().replace(head, f"{head}resources = {{ board = 1, sim = 2 }}\n")
    path.write_text(f"{text}\n[resources]\nboard = 1\nsim = 2\n")
    return path


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with DaskCluster(tmp_path_factory.mktemp("dask"), 2) as cluster:
        yield cluster


def pool_of(cluster: DaskCluster, system: Path, keep: Path) -> Pool:
    return Pool(system, 0, keep=keep, workers=ClusterWorkers(cluster.executor, open_system(system)))


def case_of(system: Path, seed: int = 0, *injections: Injection) -> TestCase:
    with Workspace(system, system.parent / "out") as workspace:
        return TestCase(workspace.unit_log("echoes"), injections, seed=seed)


def below(processes: list[psutil.Process]) -> list[psutil.Process]:
    return [each for process in processes for each in process.children(recursive=True)]


def test_each_case_has_one_outcome_though_a_worker_is_killed_and_its_evidence_comes_back(
    cluster: DaskCluster, system: Path, tmp_path: Path
) -> None:
    cases = [case_of(system, seed) for seed in range(6)]
    times = Counter[int]()

    def ended(number: int, outcome: Outcome) -> None:
        times[number] += 1
        if number == 0:
            cluster.worker_processes()[0].kill()

    with pool_of(cluster, system, tmp_path / "trials") as pool:
        outcomes = pool.map(UnitTrial("echoes"), cases, ended)
        assert [each.verdict for each in outcomes] == [Verdict.PASS] * len(cases), outcomes
        assert times == dict.fromkeys(range(len(cases)), 1)
        bad = Injection("cmd", "x", float("nan"))
        failing = pool.execute(UnitTrial("raises", evidence=True), case_of(system, 0, bad), into=tmp_path / "evidence")
        assert failing.verdict is Verdict.FAIL, failing
        assert {"trial.json", "raises.stderr.txt"} <= {path.name for path in (tmp_path / "evidence").iterdir()}
    assert wait_until(lambda: not below(cluster.worker_processes()), 30)  # workers are told, not waited for
    assert not [*(tmp_path / "trials").iterdir()]


@pytest.mark.nightly
def test_closing_ends_what_runs_on_the_workers(cluster: DaskCluster, system: Path, tmp_path: Path) -> None:
    pool = pool_of(cluster, system, tmp_path / "trials")
    ends: list[int] = []

    def ask() -> None:
        with pytest.raises(CancelledError):
            pool.map(UnitTrial("echoes"), [case_of(system, seed) for seed in range(200)], lambda n, _: ends.append(n))

    asking = threading.Thread(target=ask)
    asking.start()
    assert wait_until(lambda: len(ends) > 1, 120)
    assert below(cluster.worker_processes())
    pool.close()
    asking.join(30)
    assert not asking.is_alive()
    assert wait_until(lambda: not below(cluster.worker_processes()), 30)


@pytest.mark.nightly
def test_a_scheduler_that_dies_is_an_error_that_says_how_to_go_on(system: Path, tmp_path: Path) -> None:
    with DaskCluster(tmp_path / "dask", 1) as cluster:

        def ended(number: int, outcome: Outcome) -> None:
            if number == 1:
                cluster.scheduler.kill()

        with (
            pool_of(cluster, system, tmp_path / "trials") as pool,
            pytest.raises(EnvironmentFaultError, match="the scheduler has not answered") as told,
        ):
            pool.map(UnitTrial("echoes"), [case_of(system, seed) for seed in range(50)], ended)
    assert "run the same command again" in str(told.value)


KILLS = """
import os
class Kills:
    def judge(self, view):
        if view.inputs:
            os.kill(os.WHOM(), 9)
"""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("whom", "how"), [("getppid", "with its worker tcp://127.0.0.1:"), ("getpid", "with signal 9")]
)
def test_a_case_that_kills_its_worker_three_times_is_an_outcome_of_its_own(
    cluster: DaskCluster, system: Path, tmp_path: Path, whom: str, how: str
) -> None:
    shutil.copytree(system.parent, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("out"))
    path = tmp_path / system.name
    (tmp_path / "kills.py").write_text(KILLS.replace("WHOM", whom))
    text = path.read_text().replace("\nsim = 2\n", "\nsim = 3\n")
    path.write_text(f'{text}[[monitors]]\nkind = "kills.py"\n')
    with pool_of(cluster, path, tmp_path / "trials") as pool:
        outcome = pool.execute(UnitTrial("echoes"), case_of(path))
        assert outcome.verdict is Verdict.UNJUDGED
        assert "3 processes that executed it have ended" in outcome.detail
        assert how in outcome.detail
        assert pool.execute(IdleTrial("echoes"), TestCase()).verdict is Verdict.PASS
    with pool_of(cluster, system, tmp_path / "trials") as pool:  # with another total of `sim`
        assert pool.execute(IdleTrial("echoes"), TestCase()).verdict is Verdict.PASS


def test_an_answer_that_has_died_with_its_worker_is_not_waited_for(
    cluster: DaskCluster, system: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("riot_bus_cluster.workers._FETCH_S", 0.5)
    workers = ClusterWorkers(cluster.executor, open_system(system))
    try:
        assert wait_until(lambda: [workers._look(), any(each.begun for each in workers._states.values())][1], 60)
        asked = [each.begun for each in workers._states.values() if each.begun]
        assert wait_until(lambda: all(future.done() for future in asked), 60)
        for nanny in cluster.nannies:
            for process in psutil.Process(nanny.pid).children():
                process.kill()
        looked = threading.Thread(target=workers._look, daemon=True)  # at what the dead ones have answered
        looked.start()
        looked.join(30)
        assert not looked.is_alive()
        assert wait_until(lambda: [workers._look(), any(each.ready for each in workers._states.values())][1], 60)
    finally:
        workers.close()
