"""The local runner: trials in parallel on this machine, behind `concurrent.futures.Executor`."""

from __future__ import annotations

import queue
import shutil
import tempfile
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

from riot_bus.sut.launcher import Launcher
from riot_bus.vocabulary.trial import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from riot_bus.vocabulary.trial import Outcome, TestCase

__all__ = ["LocalRunner", "Pool", "Trial"]

_ROOM = 64 << 10
"""Bytes that a disk has left on which a component may have failed because it could not write."""


class Trial(Protocol):
    """Something that executes one test case: `UnitTrial` or `SystemTrial`."""

    def run(self, case: TestCase, launcher: Launcher, directory: Path) -> Outcome:
        """Execute the case; files may be left in `directory`."""
        ...


class Pool:
    """As many launchers as trials may run at once, and the executor that uses them.

    Args:
        jobs: Trials at once.
        keep: Folder under which the files of failing trials are kept.
        executor: Where trials run; a thread pool of this process by default (components are processes anyway).
    """

    def __init__(self, jobs: int, *, keep: Path, executor: Executor | None = None) -> None:
        self.jobs = jobs
        self.keep = keep.resolve()  # components have working folders of their own
        self._executor = executor or ThreadPoolExecutor(jobs, thread_name_prefix="riot-trial")
        self._launchers: queue.SimpleQueue[Launcher] = queue.SimpleQueue()
        self._all = [Launcher(slot) for slot in range(jobs)]
        for launcher in self._all:
            self._launchers.put(launcher)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill what still runs and give everything back; trials that have not begun are dropped."""
        for launcher in self._all:
            launcher.close()
        self._executor.shutdown(wait=True, cancel_futures=True)

    @contextmanager
    def _launcher(self) -> Iterator[Launcher]:
        launcher = self._launchers.get()
        try:
            yield launcher
        finally:
            self._launchers.put(launcher)

    def execute(self, trial: Trial, case: TestCase) -> Outcome:
        """Run one trial here and now, with a launcher and a folder of its own."""
        self.keep.mkdir(parents=True, exist_ok=True)
        directory = Path(tempfile.mkdtemp(prefix="trial-", dir=self.keep))
        outcome = None
        try:
            with self._launcher() as launcher:
                outcome = trial.run(case, launcher, directory)
            if outcome.verdict is Verdict.FAIL and shutil.disk_usage(directory).free < _ROOM:
                outcome = replace(outcome, verdict=Verdict.ERROR, detail=f"the disk is full: {self.keep}")
        finally:
            if outcome is None or outcome.log is None:
                shutil.rmtree(directory, ignore_errors=True)
        return outcome

    def map(
        self, trial: Trial, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None] = lambda *_: None
    ) -> Sequence[Outcome]:
        """Run many trials, as many at once as there are jobs; outcomes in the order of the cases.

        Args:
            trial: Executes each.
            cases: All of them.
            ended: Called with the number of a case and its outcome as it ends, on its own thread, which no signal
                interrupts.
        """

        def run(number: int, case: TestCase) -> Outcome:
            outcome = self.execute(trial, case)
            ended(number, outcome)
            return outcome

        running = [self._executor.submit(run, number, case) for number, case in enumerate(cases)]
        for done in as_completed(running):
            done.result()  # what one raises is not held up by the others
        return [each.result() for each in running]


class LocalRunner:
    """A `Runner` over a pool.

    Args:
        trial: Returns what executes the cases; called when there are some.
        pool: Where they are executed.
    """

    def __init__(self, trial: Callable[[], Trial], pool: Pool) -> None:
        self._trial = trial
        self._pool = pool

    @property
    def parallelism(self) -> int:
        """How many trials run at once."""
        return self._pool.jobs

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        return self._pool.map(self._trial(), cases) if cases else []

    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]:
        """Execute all cases likewise; `ended` is called with the number of each and its outcome as it ends."""
        return self._pool.map(self._trial(), cases, ended) if cases else []
