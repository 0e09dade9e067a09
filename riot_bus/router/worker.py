"""A thread for slow jobs, so that neither forwarders nor Zenoh's threads wait for them."""

from __future__ import annotations

import heapq
import itertools
import logging
import threading
import time
from collections import deque
from typing import TYPE_CHECKING

from riot_bus.pipeline.runner import AbandonedError

if TYPE_CHECKING:
    from collections.abc import Callable

    Job = Callable[[], None]

_LOG = logging.getLogger(__name__)


class Worker:
    """Runs jobs one after another, at once or later.

    A job may feed the pipeline. If an interceptor blocks, another thread repeats the whole job, and the blocked
    thread ends once the interceptor returns (`PipelineWorker`). So such a job must change nothing before it feeds.

    Args:
        name: Name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._jobs: deque[Job] = deque()
        self._later: list[tuple[float, int, Job, bool]] = []
        self._awaited = 0  # delayed jobs that `idle` waits for
        self._order = itertools.count()
        self._current: Job | None = None
        self._generation = 0
        self._closing = False
        self._changed = threading.Condition()
        self._thread = self._spawn()

    def do(self, job: Job) -> None:
        """Run a job as soon as those before it are done."""
        with self._changed:
            self._jobs.append(job)
            self._changed.notify()

    def later(self, seconds: float, job: Job, *, background: bool = False) -> None:
        """Run a job after a delay.

        Args:
            seconds: Delay in seconds.
            job: Function that is called on the worker's thread.
            background: Whether `idle` ignores the job during its delay.
        """
        with self._changed:
            self._awaited += not background
            heapq.heappush(self._later, (time.monotonic() + seconds, next(self._order), job, background))
            self._changed.notify()

    def idle(self) -> bool:
        """Return whether every job is done, delayed background jobs excepted."""
        with self._changed:
            return not self._jobs and self._current is None and not self._awaited

    def close(self) -> None:
        """Run the jobs that are due, then end; safe to call twice."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        while (thread := self._thread).is_alive() and thread is not threading.current_thread():
            thread.join(0.1)  # in turns, since another thread takes over if this one is stuck

    def take_over(self) -> None:
        """Continue on a new thread, starting with the job on which the current one is stuck."""
        with self._changed:
            self._generation += 1
            if self._current is not None:
                self._jobs.appendleft(self._current)
                self._current = None
            self._thread = self._spawn()

    def _spawn(self) -> threading.Thread:
        thread = threading.Thread(target=self._run, args=(self._generation,), name=self._name, daemon=True)
        thread.start()
        return thread

    def _run(self, generation: int) -> None:
        while (job := self._next(generation)) is not None:
            try:
                job()
            except AbandonedError:
                return
            except Exception:
                _LOG.exception("a job of %s failed", self._name)
            with self._changed:
                if generation == self._generation:
                    self._current = None

    def _next(self, generation: int) -> Job | None:
        with self._changed:
            while generation == self._generation:
                now = time.monotonic()
                while self._later and self._later[0][0] <= now:
                    _, _, job, background = heapq.heappop(self._later)
                    self._awaited -= not background
                    self._jobs.append(job)
                if self._jobs:
                    self._current = self._jobs.popleft()
                    return self._current
                if self._closing:
                    return None
                self._changed.wait(self._later[0][0] - now if self._later else None)
            return None
