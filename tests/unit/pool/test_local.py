"""What a pool tells its workers of hangs, and that it can be interrupted at any moment."""

from __future__ import annotations

import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Pipe
from pathlib import Path
from queue import SimpleQueue

import pytest

from riot_bus.pool.local import Pool
from riot_bus.pool.wire import Trial, TrialAnswer, TrialRequest, pack_answer, read_answer
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.unit_trial import IdleTrial
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

SPIN, WAIT, TURN = (((name, "main"),) for name in ("spin", "wait", "turn"))


class Worker:
    """Answers at once, and takes part in that as a worker that finds out something of hangs."""

    folder = None

    def __init__(self, told: list[KnownHangs], finds: Callable[[int, KnownHangs], KnownHangs]) -> None:
        self.link, self._other = Pipe()
        self._told, self._finds = told, finds
        self._known: dict[bytes, tuple[Trial, tuple[Message, ...]]] = {}

    def ask(self, request: bytes, trial: Trial, case: TestCase) -> None:
        told = TrialRequest.read(request, self._known).hangs.get("u", KnownHangs())
        self._told.append(told)
        found = self._finds(case.seed, told)
        hangs = {"u": found} if found != told else {}
        self._other.send_bytes(pack_answer(TrialAnswer(Outcome(Verdict.PASS), {}, hangs)))

    def receive(self) -> bytes:
        return self.link.recv_bytes()

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        return read_answer(data)

    def end(self) -> str | None:
        return None


class Workers:
    """As many as are asked for."""

    jobs = 2

    def __init__(self, finds: Callable[[int, KnownHangs], KnownHangs]) -> None:
        self.told: list[KnownHangs] = []
        self._finds = finds

    def open(self, wake: Callable[[], None]) -> None:
        pass

    def start(self) -> Worker:
        return Worker(self.told, self._finds)

    def close(self) -> None:
        pass


def test_what_one_worker_has_found_out_of_hangs_all_are_told(tmp_path: Path) -> None:
    def finds(seed: int, told: KnownHangs) -> KnownHangs:
        places = {0: (*told.places, SPIN), 1: (*told.places, WAIT), 2: (SPIN, WAIT)}.get(seed, told.places)
        return KnownHangs(places, max(told.longest, float(seed)))

    hangs, workers = {"u": KnownHangs((TURN,), 0.5)}, Workers(finds)
    with Pool(tmp_path / "riot.toml", 2, keep=tmp_path, workers=workers, hangs=hangs) as pool:
        for seeds in ([0, 1], [2], [3]):
            pool.map(IdleTrial("u"), [TestCase(seed=seed) for seed in seeds])
    assert workers.told[0] == KnownHangs((TURN,), 0.5)
    assert workers.told[2:] == [KnownHangs((SPIN, TURN, WAIT), 1.0), KnownHangs((SPIN, WAIT), 2.0)]
    assert hangs == {"u": KnownHangs((SPIN, WAIT), 3.0)}


@pytest.fixture
def interrupt_after() -> Iterator[Callable[[float], None]]:
    """Has a signal raise `KeyboardInterrupt` in this thread, some seconds after it is called."""
    asked: SimpleQueue[float | None] = SimpleQueue()
    main = threading.get_ident()

    def handler(*_: object) -> None:
        raise KeyboardInterrupt

    def send() -> None:
        while (delay := asked.get()) is not None:
            time.sleep(delay)
            signal.pthread_kill(main, signal.SIGUSR1)

    former = signal.signal(signal.SIGUSR1, handler)
    sender = threading.Thread(target=send)
    sender.start()
    yield asked.put
    asked.put(None)
    sender.join()
    signal.signal(signal.SIGUSR1, former)


def test_a_signal_at_any_moment_leaves_no_lock_that_holds_up_the_end(
    tmp_path: Path, interrupt_after: Callable[[float], None]
) -> None:
    moments = random.Random(1)
    cases = [TestCase(seed=seed) for seed in range(4)]

    def ask_on(pool: Pool) -> None:
        interrupt_after(moments.uniform(0, 3e-3))
        while True:
            pool.map(IdleTrial("u"), cases)

    for _ in range(500):  # where conditions of `concurrent.futures` were waited for, one of 500 did not end
        pool = Pool(tmp_path / "riot.toml", 2, keep=tmp_path, workers=Workers(lambda _, told: told))
        pool.map(IdleTrial("u"), cases)
        with pytest.raises(KeyboardInterrupt):
            ask_on(pool)
        pool.close()
