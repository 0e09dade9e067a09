"""The local runner: trials in parallel on this machine, in worker processes that are started once."""

from __future__ import annotations

import logging
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import deque
from concurrent.futures import Future, as_completed
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Pipe, wait
from pathlib import Path
from typing import TYPE_CHECKING, Self

from riot_bus.sut.persistent import KEPT
from riot_bus.sut.wire import TrialBatch, read_answer, remember
from riot_bus.vocabulary.trial import Outcome, Verdict
from riot_bus.zenoh.session import environment_of_others

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.sut.wire import Trial
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["LocalRunner", "Pool"]

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
    case: TestCase
    ended: Callable[[Outcome], None]
    future: Future[Outcome] = field(default_factory=Future)
    most: int = 1
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


class _Worker:
    """A `worker` process, as seen from here."""

    def __init__(self, system: Path, slot: int, keep: Path) -> None:
        self.slot, self._keep = slot, keep
        self.link, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "riot_bus.sut.worker", str(system.resolve()), str(slot)],
                stdin=theirs.fileno(),
                env=environment_of_others(),
                start_new_session=True,
            )
        self.task: _Task | None = None
        self.known: dict[bytes, None] = {}
        self.imports: set[str] = set()

    def end(self) -> int:
        """End it and what it has started; return its exit status."""
        self.link.close()
        try:
            return self.process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()
        finally:
            for folder in self._keep.glob(KEPT.format(self.process.pid) + "*"):
                shutil.rmtree(folder, ignore_errors=True)


class Pool:
    """Processes that execute trials, one each at a time, and one thread that feeds them.

    A worker is started when there is a case for it, and goes on until the pool is closed. One that dies is replaced,
    and its case is executed again.

    Args:
        system: Path of riot.toml.
        jobs: Trials at once, if nothing else is said with them.
        keep: Folder under which the files of failing trials are kept.
    """

    def __init__(self, system: Path, jobs: int, *, keep: Path) -> None:
        self.jobs = jobs
        self.keep = keep.resolve()  # components have working folders of their own
        self._system = system
        self._waiting: deque[_Task] = deque()
        self._workers: list[_Worker] = []
        self._imports: dict[str, Sequence[str]] = {}
        self._batches: deque[TrialBatch] = deque(maxlen=_MOST_BATCHES)
        self._lock = threading.Lock()
        self._closed = False
        self._woken, self._wake = Pipe(duplex=False)
        self._feeder = threading.Thread(target=self._feed, name="riot-trials", daemon=True)
        self._feeder.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill what still runs and give everything back; trials that have not begun are dropped."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._wake.send_bytes(b"")
        self._feeder.join()

    def execute(self, trial: Trial, case: TestCase) -> Outcome:
        """Run one trial in a folder of its own."""
        return self.map(trial, [case])[0]

    def map(
        self,
        trial: Trial,
        cases: Sequence[TestCase],
        ended: Callable[[int, Outcome], None] = lambda *_: None,
        *,
        most: int = 0,
    ) -> Sequence[Outcome]:
        """Run many trials; outcomes in the order of the cases.

        Args:
            trial: Executes each.
            cases: All of them.
            ended: Called with the number of a case and its outcome as it ends, on a thread that no signal interrupts.
            most: How many run at once; 0 for as many as there are jobs.

        Raises:
            RiotError: A trial raised it; the others are not waited for.
            OSError: Likewise, or `ended` raised it.
        """
        if not cases:
            return []
        with self._lock:
            if self._closed:
                raise RuntimeError("the pool is closed")
            batch = next((each for each in self._batches if each.trial == trial), None)
            if batch is None:
                batch = TrialBatch(trial, cases[0].messages)
                self._batches.append(batch)
            most = most or self.jobs
            tasks = [_Task(batch, case, partial(ended, number), most=most) for number, case in enumerate(cases)]
            self._waiting.extend(tasks)
            self._wake.send_bytes(b"")
        for done in as_completed([task.future for task in tasks]):
            done.result()  # what one raises is not held up by the others
        return [task.future.result() for task in tasks]

    def _feed(self) -> None:
        """Give cases to workers and take their answers, until the pool is closed."""
        try:
            while not self._closed:
                self._start_waiting()
                links = {worker.link: worker for worker in self._workers}
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
            if sum(each.task is not None for each in self._workers) >= self._waiting[0].most:
                return
            task = self._waiting.popleft()
            try:
                if worker is None:
                    slot = min(set(range(len(self._workers) + 1)) - {each.slot for each in self._workers})
                    worker = _Worker(self._system, slot, self.keep)
                    self._workers.append(worker)
                self._give(task, worker)
            except Exception as error:  # the disk is full, there is no process to be had: whoever asked is told
                task.remove_directory()
                task.future.set_exception(error)

    def _give(self, task: _Task, worker: _Worker) -> None:
        imports = {name: each for name, each in self._imports.items() if name not in worker.imports}
        whole = task.batch.digest not in worker.known
        directory = task.make_directory(self.keep)
        request = task.batch.request(task.case, directory=directory, whole=whole, imports=imports)
        worker.task = task
        with suppress(OSError):  # it has died, as its link will tell
            worker.link.send_bytes(request)
        worker.imports |= imports.keys()
        if whole:
            remember(worker.known, task.batch.digest, None)

    def _take_answer(self, worker: _Worker) -> None:
        task = worker.task
        try:
            data = worker.link.recv_bytes()
        except (EOFError, OSError):
            self._workers.remove(worker)
            status = worker.end()
            if task is not None:
                self._again(task, status)
            return
        worker.task = None
        if task is None:
            return
        try:
            answer = read_answer(data)
            self._imports.update(answer.imports)
            worker.imports |= answer.imports.keys()
            self._start_waiting()
            self._finish(task, answer.outcome)
        except Exception as error:  # as the trial, or a full disk, has raised it
            task.remove_directory()
            task.future.set_exception(error)

    def _again(self, task: _Task, status: int) -> None:
        """Have a case executed again whose worker has ended, unless it was not the first one."""
        task.deaths += 1
        how = f"with signal {-status}" if status < 0 else f"with status {status}"
        _LOG.warning("the process of a trial has ended %s", how)
        task.remove_directory()
        if task.deaths < _DEATHS:
            self._waiting.appendleft(task)
            return
        text = f"{_DEATHS} processes that executed this case have ended one after the other, the last one {how}"
        try:
            self._finish(task, Outcome(Verdict.ERROR, detail=text))
        except Exception as error:
            task.future.set_exception(error)

    def _finish(self, task: _Task, outcome: Outcome) -> None:
        if outcome.verdict is Verdict.FAIL and shutil.disk_usage(self.keep).free < _ROOM:
            outcome = replace(outcome, verdict=Verdict.ERROR, detail=f"the disk is full: {self.keep}")
        if outcome.log is None:
            task.remove_directory()
        task.ended(outcome)
        task.future.set_result(outcome)

    def _end(self) -> None:
        with self._lock:
            self._closed = True
        for worker in self._workers:
            worker.link.close()
        for worker in self._workers:
            worker.end()
        for task in (*self._waiting, *(worker.task for worker in self._workers)):
            if task is not None:
                task.remove_directory()
                task.future.cancel()
                task.future.set_running_or_notify_cancel()
        self._woken.close()
        self._wake.close()


class LocalRunner:
    """A `Runner` over a pool.

    Args:
        trial: Returns what executes the cases; called when there are some.
        pool: Where they are executed.
        slots: Returns how many of its trials run at once.
    """

    def __init__(self, trial: Callable[[], Trial], pool: Pool, slots: Callable[[], int]) -> None:
        self._trial = trial
        self._pool = pool
        self._slots = slots

    @property
    def parallelism(self) -> int:
        """How many trials run at once."""
        return self._slots()

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        return self.each(cases, lambda *_: None)

    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]:
        """Execute all cases likewise; `ended` is called with the number of each and its outcome as it ends."""
        if not cases:
            return []
        most = self._slots() if len(cases) > self._pool.jobs else self._pool.jobs
        return self._pool.map(self._trial(), cases, ended, most=most)
