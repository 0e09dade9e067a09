"""A worker outlives signals and what trials raise, not the socket to the process that asks."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import psutil
import pytest

from riot_bus.pool.local import Pool
from riot_bus.pool.wire import TrialAnswer, TrialBatch, read_answer
from riot_bus.pool.worker import TrialWorker
from riot_bus.trial.unit_trial import IdleTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.trial import TestCase, Verdict
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration

PROGRAM = """
import json, os, pathlib, signal, sys, time
path = pathlib.Path(sys.argv[1])
blocked = [each.name for each in signal.pthread_sigmask(signal.SIG_BLOCK, [])]
taken = [str(signal.getsignal(each)) for each in (signal.SIGTERM, signal.SIGHUP)]
path.with_suffix(".part").write_text(json.dumps([os.environ.get("ZENOH_RUNTIME"), blocked, taken]))
path.with_suffix(".part").rename(path)
time.sleep(600)
"""


@pytest.fixture
def system(tmp_path: Path) -> Path:
    (tmp_path / "node.py").write_text(PROGRAM)
    path = tmp_path / "riot.toml"
    path.write_text(
        f'[components.one]\ncommand = ["{{python}}", "node.py", "{tmp_path}/told"]\n'
        "ready = { timeout = 120 }\n[unit.one]\n"
    )
    return path


@pytest.fixture
def pool(system: Path, tmp_path: Path) -> Iterator[Pool]:
    with Pool(system, 1, keep=tmp_path / "trials") as pool:
        yield pool


class NoLauncher:
    """Starts nothing."""

    def cpu(self) -> float:
        return 0.0


def answer(worker: TrialWorker, tmp_path: Path, unit: str) -> TrialAnswer:
    batch = TrialBatch(IdleTrial(unit), ())
    return read_answer(worker.answer(batch.request(TestCase(), directory=tmp_path, whole=True, imports={})))


def test_what_goes_wrong_is_an_answer(system: Path, tmp_path: Path) -> None:
    worker = TrialWorker(system, NoLauncher())  # type: ignore[arg-type]
    with pytest.raises(RuntimeError, match="Traceback"):
        read_answer(worker.answer(b"no request"))
    with pytest.raises(RuntimeError, match="KeyError: 'two'"):
        answer(worker, tmp_path, "two")
    system.write_text("[compnents.one]\n")
    with pytest.raises(ConfigError, match="'components' is missing"):
        answer(TrialWorker(system, NoLauncher()), tmp_path, "one")  # type: ignore[arg-type]


@pytest.mark.parametrize("own", [None, "(rx: (worker_threads: 7))"])
def test_components_get_the_environment_of_riot_and_take_signals(
    system: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: str | None
) -> None:
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    if own:
        monkeypatch.setenv("ZENOH_RUNTIME", own)
    system.write_text(system.read_text().replace("timeout = 120", "timeout = 5"))
    with Pool(system, 1, keep=tmp_path / "trials") as pool:
        outcome = pool.execute(IdleTrial("one"), TestCase())
    assert outcome.verdict is Verdict.ERROR
    assert "has not connected" in outcome.detail
    assert json.loads((tmp_path / "told").read_text()) == [own, [], ["0", "0"]]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_worker_ends_with_its_socket_and_by_no_signal_before(
    pool: Pool, tmp_path: Path, number: signal.Signals
) -> None:
    told = tmp_path / "told"

    def ask() -> None:
        with pytest.raises(CancelledError):
            pool.execute(IdleTrial("one"), TestCase())

    asking = threading.Thread(target=ask)
    asking.start()
    assert wait_until(told.exists, 60)
    (worker,) = [each for each in psutil.Process().children() if "riot_bus.pool.worker" in each.cmdline()]
    below = worker.children(recursive=True)
    assert len(below) == 2  # supervisor and component
    os.kill(worker.pid, number)
    assert not wait_until(lambda: not worker.is_running(), 0.3)
    pool.close()
    asking.join()
    assert not psutil.wait_procs(below, timeout=10)[1]
