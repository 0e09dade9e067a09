"""The local runner: trials in parallel on this machine, in worker processes that are started once.

The states of a case in a pool (`_Task`):

    state      from       by
    queued     -, sent    `map`; or the death of its worker, which puts it in front of the others
    sent       queued     `_assign`: the first idle worker, or a new one while fewer work than may
    finished   sent       its answer, or the third worker that dies of it (`UNJUDGED`); `map` returns the outcome
    failed     any        an exception of the trial or of the disk, or the end of the pool; `map` raises it
"""

from __future__ import annotations

import logging
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from queue import SimpleQueue
from typing import Protocol, Self

from riot_bus.pool.wire import MOST_KNOWN, Trial, TrialAnswer, TrialBatch, read_answer, remember
from riot_bus.processes.launcher import TORN_DOWN_WITHIN_S
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.running_system import FOLDER_PREFIX
from riot_bus.trial.setup import TrialPlace
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from riot_bus.zenoh.session import environment_of_others

_LOG = logging.getLogger(__name__)
_DEATHS = 3
"""Number of workers that may die of one case: one may die by chance, such as for lack of memory, but not three."""
_ENDS_WITHIN_S = TORN_DOWN_WITHIN_S + 10.0  # a worker ends its components first: seconds, even on a loaded machine


@dataclass(eq=False, slots=True)
class _Task:
    """A case to execute, the receivers of its outcome, and the number of trials that may run at once with it."""

    batch: TrialBatch
    number: int
    case: TestCase
    ended: Callable[[int, Outcome], None]
    answers: SimpleQueue[tuple[int, Outcome | Exception]]
    into: Path | None = None
    most: int = 0
    directory: Path | None = None
    deaths: int = 0

    def remove_directory(self) -> None:
        """Remove the folder of the case, if there is one."""
        if self.directory is not None:
            shutil.rmtree(self.directory, ignore_errors=True)
        self.directory = None

    def fail(self, error: Exception) -> None:
        """Pass an error to the caller that asked for the case, where it is raised."""
        self.remove_directory()
        self.answers.put((self.number, error))


class WorkerLink(Protocol):
    """A process that executes cases, one at a time, as a pool sees it.

    Attributes:
        link: Connection that is readable when there is an answer, or when the process has ended.
        folder: Folder of the trials, if they run elsewhere.
    """

    link: Connection

    @property
    def folder(self) -> Path | None:  # noqa: D102
        ...

    def ask(self, request: bytes, trial: Trial, case: TestCase) -> None:
        """Send a case for execution; `request` holds trial and case."""

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        """Return the answer in received data, and ensure that the files of the trial are in its folder.

        Raises:
            Exception: An exception that the trial, or a full disk, has raised.
        """

    def end(self) -> str | None:
        """End the process and its descendants; return how it has ended, None if its case is not the cause."""


class WorkerSource(Protocol):
    """A source of workers for a pool."""

    @property
    def jobs(self) -> int:
        """Number of workers that work at once, unless the cases ask for another number."""

    def open(self, wake: Callable[[], None]) -> None:
        """Open the source; it has to call `wake` when a new worker is available."""

    def start(self) -> WorkerLink | None:
        """Return a further worker, None if none is available at the moment.

        Raises:
            EnvironmentFaultError: No worker will ever be available again.
        """

    def close(self) -> None:
        """Release everything, and end the work of workers that do not end with their links."""


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

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        return read_answer(data)

    def end(self) -> str:
        self.link.close()
        try:
            return how_ended(self.process)
        finally:
            for folder in self._keep.glob(FOLDER_PREFIX.format(self.process.pid) + "*"):
                shutil.rmtree(folder, ignore_errors=True)


def start_worker(system: Path, slot: int, link: Connection, *, cwd: Path | None = None) -> subprocess.Popen[bytes]:
    """Start a `worker` process.

    Args:
        link: Connection for requests; the worker ends when the other end is closed.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "riot_bus.pool.worker", str(system.resolve()), str(slot)],
        stdin=link.fileno(),
        env=environment_of_others(),
        start_new_session=True,
        cwd=cwd,
    )


def how_ended(process: subprocess.Popen[bytes]) -> str:
    """Wait until a worker with a closed link has ended, and return how; kill it if it does not end."""
    try:
        status = process.wait(_ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        status = process.wait()
    return f"with signal {-status}" if status < 0 else f"with status {status}"


class LocalWorkers:
    """Worker processes of this machine, each started when there is a case for it."""

    def __init__(self, system: Path, jobs: int, keep: Path) -> None:
        self.jobs = jobs
        self._system, self._keep = system, keep
        self._slots: dict[int, _LocalWorker] = {}

    def open(self, wake: Callable[[], None]) -> None:
        """Do nothing: further workers are always available."""

    def start(self) -> WorkerLink | None:
        """Start a further worker in a free slot."""
        taken = {number for number, each in self._slots.items() if not each.link.closed}
        slot = min(set(range(len(taken) + 1)) - taken)
        self._slots[slot] = _LocalWorker(self._system, slot, self._keep)
        return self._slots[slot]

    def close(self) -> None:
        """Do nothing: workers end when their links are closed."""


@dataclass(eq=False, slots=True)
class _PoolWorker:
    """A worker of the pool, its present task, and what it was already sent."""

    process: WorkerLink
    task: _Task | None = None
    known: dict[bytes, None] = field(default_factory=dict)
    imports: set[str] = field(default_factory=set)
    hangs: dict[str, KnownHangs] = field(default_factory=dict)


class Pool:
    """Processes that execute trials, one each at a time, and one thread that feeds them.

    Args:
        keep: Folder in which the files of failing trials are kept.
        workers: Source of workers to use instead of processes of this machine; it then decides on `jobs`.
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
        self._queue: deque[_Task] = deque()
        self._workers: list[_PoolWorker] = []
        self._imports: dict[str, Sequence[str]] = {}
        self._hangs = {} if hangs is None else hangs
        self._batches: deque[TrialBatch] = deque(maxlen=MOST_KNOWN)
        self._lock = threading.Lock()
        self._closed = False
        self._woken, self._wake = Pipe(duplex=False)
        self._source.open(self._notify)
        self._feeder = threading.Thread(target=self._feed, name="riot-trials", daemon=True)
        self._feeder.start()

    @property
    def jobs(self) -> int:
        """Number of trials that run at once."""
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
        """Run one trial in a separate folder, and move what it was asked to leave to `into`."""
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
            ended: Function called with number and outcome of each ended case, on a thread that no signal interrupts.
            into: Target of what a case is asked to leave; None to drop it.
            most: Number of trials at once; 0 for the present number of jobs, which varies in a cluster.

        Raises:
            RiotError: A trial raised it; the others are not waited for.
            OSError: A trial or `ended` raised it.
        """
        if not cases:
            return []
        # A signal handler may raise here, on the main thread. The wait must not hold a lock then that the other thread
        # needs, as the conditions of `threading` and `concurrent.futures` do.
        answers: SimpleQueue[tuple[int, Outcome | Exception]] = SimpleQueue()
        with self._lock:
            if self._closed:
                raise RuntimeError("the pool is closed")
            batch = next((each for each in self._batches if each.trial == trial), None)
            if batch is None:
                batch = TrialBatch(trial, cases[0].messages)
                self._batches.append(batch)
            self._queue.extend(
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
        """Send cases to workers and receive their answers, until the pool is closed."""
        try:
            while not self._closed:
                self._assign()
                links = {worker.process.link: worker for worker in self._workers}
                for ready in wait([self._woken, *links]):
                    if ready is self._woken:
                        self._woken.recv_bytes()
                    else:
                        self._receive(links[ready])  # type: ignore[index]
        finally:
            self._end()

    def _assign(self) -> None:
        """Send queued cases to workers that have none."""
        while self._queue:
            worker = next((each for each in self._workers if each.task is None), None)
            if sum(each.task is not None for each in self._workers) >= (self._queue[0].most or self.jobs):
                return
            task = self._queue.popleft()
            try:
                if worker is None:
                    process = self._source.start()
                    if process is None:
                        self._queue.appendleft(task)
                        return
                    worker = _PoolWorker(process)
                    self._workers.append(worker)
                self._send(task, worker)
            except Exception as error:  # such as a full disk: raised where the outcome is awaited
                task.fail(error)

    def _send(self, task: _Task, worker: _PoolWorker) -> None:
        imports = {name: each for name, each in self._imports.items() if name not in worker.imports}
        whole = task.batch.digest not in worker.known
        self.keep.mkdir(parents=True, exist_ok=True)
        task.directory = Path(tempfile.mkdtemp(prefix="trial-", dir=self.keep))
        worker.hangs = self._hangs.copy()
        request = task.batch.request(
            task.case,
            directory=worker.process.folder or task.directory,
            whole=whole,
            imports=imports,
            hangs=worker.hangs,
        )
        worker.task = task
        worker.process.ask(request, task.batch.trial, task.case)
        worker.imports |= imports.keys()
        if whole:
            remember(worker.known, task.batch.digest, None)

    def _receive(self, worker: _PoolWorker) -> None:
        task = worker.task
        try:
            data = worker.process.link.recv_bytes()
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
            self._assign()
            self._finish(task, answer.outcome)
        except Exception as error:  # as the trial, or a full disk, has raised it
            task.fail(error)

    def _again(self, task: _Task, how: str | None) -> None:
        """Execute a case again whose worker has died, unless too many workers have died of it."""
        task.remove_directory()
        if how is not None:
            task.deaths += 1
            _LOG.warning("the process of a trial has ended %s", how)
        if task.deaths < _DEATHS:
            self._queue.appendleft(task)
            return
        text = f"{_DEATHS} processes that executed it have ended one after the other, the last one {how}"
        try:
            self._finish(task, Outcome(Verdict.UNJUDGED, detail=text))
        except Exception as error:
            task.fail(error)

    def _finish(self, task: _Task, outcome: Outcome) -> None:
        # Bytes: a component may have failed because it could not write.
        if outcome.verdict is Verdict.FAIL and shutil.disk_usage(self.keep).free < 64 << 10:
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
        for task in (*self._queue, *(worker.task for worker in self._workers)):
            if task is not None:
                task.fail(CancelledError())
        self._woken.close()
        self._wake.close()


class LocalRunner:
    """A `Runner` over a pool.

    Args:
        slots: Function that returns how many trials run at once, given the share of a processor that earlier trials
            took, 0 if there were none.
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
        """Number of cases worth asking for at once."""
        return self._batch or self._at_once()

    def _at_once(self) -> int:
        return self._slots(self._busy / self._seconds if self._seconds else 0.0)

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        return self.each(cases, lambda *_: None)

    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]:
        """Execute all cases as `run` does, and call `ended` with number and outcome of each case that ends."""
        if not cases:
            return []
        most = self._at_once() if len(cases) > self._pool.jobs else 0
        most = most if most > self._pool.jobs else 0
        outcomes = self._pool.map(self._trial(), cases, ended, into=self._into, most=most)
        for outcome in outcomes:
            self._busy += outcome.statistics.get("busy", 0.0) * outcome.seconds
            self._seconds += outcome.seconds
        return outcomes
