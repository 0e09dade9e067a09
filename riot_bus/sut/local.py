"""The local runner: trials in parallel on this machine, in worker processes that are started once."""

from __future__ import annotations

import logging
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import deque
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Protocol, Self

from riot_bus.sut.hangs import KnownHangs
from riot_bus.sut.persistent import KEPT
from riot_bus.sut.stage import TrialPlace
from riot_bus.sut.wire import TrialBatch, read_answer, remember
from riot_bus.vocabulary.trial import Outcome, Verdict
from riot_bus.zenoh.session import environment_of_others

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.sut.wire import Trial, TrialAnswer
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["LocalRunner", "LocalWorkers", "Pool", "WorkerLink", "WorkerSource", "how_ended", "start_worker"]

_LOG = logging.getLogger(__name__)
_ROOM = 64 << 10
"""Bytes that a disk has left on which a component may have failed because it could not write."""
_DEATHS = 3
"""Workers that one case may cost: one may be killed by chance, such as for want of memory, three are no chance."""
_ENDS_WITHIN_S = 30.0
_MOST_BATCHES = 4


@dataclass(eq=False, slots=True)
class _Task:
    """A case that is to be executed, who is told, and how many trials may run at once then."""

    batch: TrialBatch
    number: int
    case: TestCase
    ended: Callable[[int, Outcome], None]
    answers: SimpleQueue[tuple[int, Outcome | Exception]]
    into: Path | None = None
    most: int = 0
    directory: Path | None = None
    deaths: int = 0

    def make_directory(self, keep: Path) -> Path:
        """Make its folder under that of all."""
        keep.mkdir(parents=True, exist_ok=True)
        self.directory = Path(tempfile.mkdtemp(prefix="trial-", dir=keep))
        return self.directory

    def remove_directory(self) -> None:
        """Remove the folder that it has made, if it has."""
        if self.directory is not None:
            shutil.rmtree(self.directory, ignore_errors=True)
        self.directory = None

    def fail(self, error: Exception) -> None:
        """Have what went wrong raised where the case was asked for."""
        self.remove_directory()
        self.answers.put((self.number, error))


class WorkerLink(Protocol):
    """A process that executes cases, one at a time, as a pool sees it.

    Attributes:
        link: Can be read when there is an answer, or when it has ended.
        folder: Where trials have their folders, if that is not here.
    """

    link: Connection

    @property
    def folder(self) -> Path | None:  # noqa: D102
        ...

    def ask(self, request: bytes, trial: Trial, case: TestCase) -> None:
        """Have a case executed; `request` holds trial and case."""
        ...

    def receive(self) -> bytes:
        """Return what has come.

        Raises:
            EOFError: It has ended.
            OSError: Likewise.
        """
        ...

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        """Return the answer that has come, and see to it that what the trial has left is in its folder.

        Raises:
            Exception: What the trial, or a full disk, has raised.
        """
        ...

    def end(self) -> str | None:
        """End it and what it has started; return how it has ended, None if its case has no part in that."""
        ...


class WorkerSource(Protocol):
    """Where a pool gets its workers from."""

    @property
    def jobs(self) -> int:
        """How many work at once, if nothing else is said with cases."""
        ...

    def open(self, wake: Callable[[], None]) -> None:
        """Begin; `wake` is to be called when there is a worker that there was not before."""
        ...

    def start(self) -> WorkerLink | None:
        """Return a further worker, None if there is none at the moment.

        Raises:
            EnvironmentFaultError: There will be none any more.
        """
        ...

    def close(self) -> None:
        """Give everything back, and end what workers do that do not end with their links."""
        ...


class _LocalWorker:
    """A `worker` process of this machine."""

    folder = None

    def __init__(self, system: Path, slot: int, keep: Path) -> None:
        self.slot, self._keep = slot, keep
        self.link, theirs = Pipe()
        with theirs:
            self.process = start_worker(system, slot, theirs)

    def ask(self, request: bytes, trial: Trial, case: TestCase) -> None:
        with suppress(OSError):  # it has died, as its link will tell
            self.link.send_bytes(request)

    def receive(self) -> bytes:
        return self.link.recv_bytes()

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        return read_answer(data)

    def end(self) -> str:
        self.link.close()
        try:
            return how_ended(self.process)
        finally:
            for folder in self._keep.glob(KEPT.format(self.process.pid) + "*"):
                shutil.rmtree(folder, ignore_errors=True)


def start_worker(system: Path, slot: int, link: Connection, *, cwd: Path | None = None) -> subprocess.Popen[bytes]:
    """Start a `worker` process.

    Args:
        system: Path of riot.toml.
        slot: A number that no other has at the same time.
        link: Where it takes requests; it ends when the other end is closed.
        cwd: Its working folder; None for that of this process.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "riot_bus.sut.worker", str(system.resolve()), str(slot)],
        stdin=link.fileno(),
        env=environment_of_others(),
        start_new_session=True,
        cwd=cwd,
    )


def how_ended(process: subprocess.Popen[bytes]) -> str:
    """Wait until a worker has ended whose link is closed, and return how; one that does not is killed."""
    try:
        status = process.wait(_ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        status = process.wait()
    return f"with signal {-status}" if status < 0 else f"with status {status}"


class LocalWorkers:
    """Worker processes of this machine, each started when there is a case for it.

    Args:
        system: Path of riot.toml.
        jobs: How many work at once, if nothing else is said with cases.
        keep: Folder under which trials have their folders.
    """

    def __init__(self, system: Path, jobs: int, keep: Path) -> None:
        self.jobs = jobs
        self._system, self._keep = system, keep
        self._slots: dict[int, _LocalWorker] = {}

    def open(self, wake: Callable[[], None]) -> None:
        """Do nothing: there are always as many as there may be."""

    def start(self) -> WorkerLink | None:
        """Start a further one in a slot that is free."""
        taken = {number for number, each in self._slots.items() if not each.link.closed}
        slot = min(set(range(len(taken) + 1)) - taken)
        self._slots[slot] = _LocalWorker(self._system, slot, self._keep)
        return self._slots[slot]

    def close(self) -> None:
        """Do nothing: they end with their links."""


@dataclass(eq=False, slots=True)
class _PoolWorker:
    """A worker of the pool, what it does, and what it knows already."""

    process: WorkerLink
    task: _Task | None = None
    known: dict[bytes, None] = field(default_factory=dict)
    imports: set[str] = field(default_factory=set)
    hangs: dict[str, KnownHangs] = field(default_factory=dict)


class Pool:
    """Processes that execute trials, one each at a time, and one thread that feeds them.

    A worker is started when there is a case for it, and goes on until the pool is closed. One that dies is replaced,
    and its case is executed again.

    Args:
        system: Path of riot.toml.
        jobs: Trials at once, if nothing else is said with them.
        keep: Folder under which the files of failing trials are kept.
        workers: Where they are executed instead of by processes of this machine; `jobs` is then up to that.
        hangs: What is known of hangs, by component; trials change it.
    """

    def __init__(
        self,
        system: Path,
        jobs: int,
        *,
        keep: Path,
        workers: WorkerSource | None = None,
        hangs: dict[str, KnownHangs] | None = None,
    ) -> None:
        self.keep = keep.resolve()  # components have working folders of their own
        self._source = workers or LocalWorkers(system, jobs, self.keep)
        self._waiting: deque[_Task] = deque()
        self._workers: list[_PoolWorker] = []
        self._imports: dict[str, Sequence[str]] = {}
        self._hangs = {} if hangs is None else hangs
        self._batches: deque[TrialBatch] = deque(maxlen=_MOST_BATCHES)
        self._lock = threading.Lock()
        self._closed = False
        self._woken, self._wake = Pipe(duplex=False)
        self._source.open(self._notify)
        self._feeder = threading.Thread(target=self._feed, name="riot-trials", daemon=True)
        self._feeder.start()

    @property
    def jobs(self) -> int:
        """How many trials run at once."""
        return self._source.jobs

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill what still runs and give everything back; trials that have not begun are dropped."""
        with self._lock:
            self._closed = True
            with suppress(OSError):  # the thread has ended already
                self._wake.send_bytes(b"")
        self._feeder.join()

    def _notify(self) -> None:
        """Have the thread look again for workers."""
        with self._lock:
            if not self._closed:
                self._wake.send_bytes(b"")

    def execute(self, trial: Trial, case: TestCase, *, into: Path | None = None) -> Outcome:
        """Run one trial in a folder of its own; what it leaves as it was asked to is moved to `into`."""
        return self.map(trial, [case], into=into)[0]

    def map(
        self,
        trial: Trial,
        cases: Sequence[TestCase],
        ended: Callable[[int, Outcome], None] = lambda *_: None,
        *,
        into: Path | None = None,
        most: int = 0,
    ) -> Sequence[Outcome]:
        """Run many trials; outcomes in the order of the cases.

        Args:
            trial: Executes each.
            cases: The test cases, one for each trial.
            ended: Called with the number of a case and its outcome as it ends, on a thread that no signal interrupts.
            into: Where that goes which a case leaves as it is asked to; None to drop it.
            most: How many run at once; 0 for as many as there are jobs by then: workers of a cluster come and go.

        Raises:
            RiotError: A trial raised it; the others are not waited for.
            OSError: Likewise, or `ended` raised it.
        """
        if not cases:
            return []
        # A signal may raise in the middle of this, on the main thread: what waits here must not hold a lock then that
        # the other thread needs, as the conditions of `threading` and `concurrent.futures` do.
        answers: SimpleQueue[tuple[int, Outcome | Exception]] = SimpleQueue()
        with self._lock:
            if self._closed:
                raise RuntimeError("the pool is closed")
            batch = next((each for each in self._batches if each.trial == trial), None)
            if batch is None:
                batch = TrialBatch(trial, cases[0].messages)
                self._batches.append(batch)
            self._waiting.extend(
                _Task(batch, number, case, ended, answers, into, most) for number, case in enumerate(cases)
            )
            self._wake.send_bytes(b"")
        outcomes: dict[int, Outcome] = {}
        while len(outcomes) < len(cases):
            number, answer = answers.get()
            if isinstance(answer, Exception):  # it is not held up by the others
                raise answer
            outcomes[number] = answer
        return [outcomes[number] for number in range(len(cases))]

    def _feed(self) -> None:
        """Give cases to workers and take their answers, until the pool is closed."""
        try:
            while not self._closed:
                self._start_waiting()
                links = {worker.process.link: worker for worker in self._workers}
                for ready in wait([self._woken, *links]):
                    if ready is self._woken:
                        self._woken.recv_bytes()
                    else:
                        self._take_answer(links[ready])  # type: ignore[index]
        finally:
            self._end()

    def _start_waiting(self) -> None:
        """Give waiting cases to workers that have none."""
        while self._waiting:
            worker = next((each for each in self._workers if each.task is None), None)
            if sum(each.task is not None for each in self._workers) >= (self._waiting[0].most or self.jobs):
                return
            task = self._waiting.popleft()
            try:
                if worker is None:
                    process = self._source.start()
                    if process is None:
                        self._waiting.appendleft(task)
                        return
                    worker = _PoolWorker(process)
                    self._workers.append(worker)
                self._give(task, worker)
            except Exception as error:  # the disk is full, there is no process to be had: whoever asked is told
                task.fail(error)

    def _give(self, task: _Task, worker: _PoolWorker) -> None:
        imports = {name: each for name, each in self._imports.items() if name not in worker.imports}
        whole = task.batch.digest not in worker.known
        directory = task.make_directory(self.keep)
        worker.hangs = self._hangs.copy()
        request = task.batch.request(
            task.case,
            directory=worker.process.folder or directory,
            whole=whole,
            imports=imports,
            hangs=worker.hangs,
        )
        worker.task = task
        worker.process.ask(request, task.batch.trial, task.case)
        worker.imports |= imports.keys()
        if whole:
            remember(worker.known, task.batch.digest, None)

    def _take_answer(self, worker: _PoolWorker) -> None:
        task = worker.task
        try:
            data = worker.process.receive()
        except (EOFError, OSError):
            self._workers.remove(worker)
            how = worker.process.end()
            if task is not None:
                self._again(task, how)
            return
        worker.task = None
        if task is None or task.directory is None:
            return
        try:
            answer = worker.process.read(data, task.directory)
            self._imports.update(answer.imports)
            worker.imports |= answer.imports.keys()
            for name, found in answer.hangs.items():
                known, told = (each.get(name, KnownHangs()) for each in (self._hangs, worker.hangs))
                self._hangs[name] = known.changed(told, found)
            self._start_waiting()
            self._finish(task, answer.outcome)
        except Exception as error:  # as the trial, or a full disk, has raised it
            task.fail(error)

    def _again(self, task: _Task, how: str | None) -> None:
        """Have a case executed again whose worker has ended, unless that was the last one that it may cost."""
        task.remove_directory()
        if how is not None:
            task.deaths += 1
            _LOG.warning("the process of a trial has ended %s", how)
        if task.deaths < _DEATHS:
            self._waiting.appendleft(task)
            return
        text = f"{_DEATHS} processes that executed it have ended one after the other, the last one {how}"
        try:
            self._finish(task, Outcome(Verdict.UNJUDGED, detail=text))
        except Exception as error:
            task.fail(error)

    def _finish(self, task: _Task, outcome: Outcome) -> None:
        if outcome.verdict is Verdict.FAIL and shutil.disk_usage(self.keep).free < _ROOM:
            outcome = replace(outcome, verdict=Verdict.ERROR, detail=f"the disk is full: {self.keep}")
        if task.directory is not None:
            left = task.directory / TrialPlace.LEFT
            if task.into is not None and left.exists():
                shutil.move(left, task.into)
            if outcome.log is not None:  # it was executed in a folder that may have been elsewhere
                outcome = replace(outcome, log=str(task.directory / Path(outcome.log).name))
        if outcome.log is None:
            task.remove_directory()
        task.ended(task.number, outcome)
        task.answers.put((task.number, outcome))

    def _end(self) -> None:
        with self._lock:
            self._closed = True
        self._source.close()
        for worker in self._workers:
            worker.process.link.close()
        for worker in self._workers:
            worker.process.end()
        for task in (*self._waiting, *(worker.task for worker in self._workers)):
            if task is not None:
                task.fail(CancelledError())
        self._woken.close()
        self._wake.close()


class LocalRunner:
    """A `Runner` over a pool.

    Args:
        trial: Returns what executes the cases; called when there are some.
        pool: Where they are executed.
        slots: Returns how many of its trials run at once, from the share of a processor that those so far have taken,
            0 if there was none.
        into: Where that goes which a case leaves as it is asked to.
        batch: How many cases are worth asking for at once; 0 for as many as run at once.
    """

    def __init__(
        self,
        trial: Callable[[], Trial],
        pool: Pool,
        slots: Callable[[float], int],
        *,
        into: Path | None = None,
        batch: int = 0,
    ) -> None:
        self._trial = trial
        self._pool = pool
        self._slots = slots
        self._into = into
        self._batch = batch
        self._busy = self._seconds = 0.0

    @property
    def parallelism(self) -> int:
        """How many cases are worth asking for at once."""
        return self._batch or self._at_once()

    def _at_once(self) -> int:
        return self._slots(self._busy / self._seconds if self._seconds else 0.0)

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        return self.each(cases, lambda *_: None)

    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]:
        """Execute all cases likewise; `ended` is called with the number of each and its outcome as it ends."""
        if not cases:
            return []
        most = self._at_once() if len(cases) > self._pool.jobs else 0
        most = most if most > self._pool.jobs else 0
        outcomes = self._pool.map(self._trial(), cases, ended, into=self._into, most=most)
        for outcome in outcomes:
            self._busy += outcome.statistics.get("busy", 0.0) * outcome.seconds
            self._seconds += outcome.seconds
        return outcomes
