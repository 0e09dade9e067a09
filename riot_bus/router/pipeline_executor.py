"""The executor of the pipeline: lets in one thread at a time, and none for ever."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol

from riot_bus.pipeline.event import Arrival, Event
from riot_bus.pipeline.runner import AbandonedError, Pipeline, Result
from riot_bus.pipeline.stage import Stage
from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
BUDGET_S = 1.0
"""How long an interceptor may take for one message before it is bypassed."""


class PipelineWorker(Protocol):
    """An object whose thread runs the pipeline."""

    def take_over(self) -> None:
        """Continue on a new thread, since the current one is stuck in an interceptor."""
        ...


class PipelineExecutor:
    """Lets several threads feed one pipeline, and frees them from an interceptor that blocks.

    Args:
        budget_s: Longest time of one interceptor for one message, in seconds.
    """

    def __init__(self, pipeline: Pipeline, *, budget_s: float = BUDGET_S) -> None:
        self.pipeline = pipeline
        self._budget_s = budget_s
        self._lock = threading.Lock()
        self._thread_id = 0
        self._worker: PipelineWorker | None = None
        self._stop = threading.Event()
        self._watch: threading.Thread | None = None

    def start(self) -> None:
        """Start to watch for interceptors that block, unless that was started."""
        if self._watch is None:
            self._watch = threading.Thread(target=self._watching, name="riot-executor", daemon=True)
            self._watch.start()

    def close(self) -> None:
        """Stop watching; safe to call twice."""
        self._stop.set()
        if self._watch is not None:
            self._watch.join()
            self._watch = None

    def feed(
        self,
        key: str,
        now: int,
        *,
        message: Message | None = None,
        arrival: Arrival | None = None,
        segment: str = "",
        targets: tuple[str, ...] = (),
        worker: PipelineWorker | None = None,
    ) -> tuple[Event, Result | None]:
        """Run one message through the pipeline.

        Args:
            key: The message's key.
            now: The message's time, in nanoseconds.
            message: The message; None if there is `arrival`.
            arrival: Received sample that makes the message on demand.
            segment: Segment that the message comes from.
            targets: Segments that the message goes to.
            worker: Worker that is notified if its thread gets stuck; if None, the thread repeats the message when the
                interceptor returns.

        Returns:
            The event, and its result; None if the message goes to all targets at once with at most a new payload.

        Raises:
            AbandonedError: `worker` continues on a new thread.
        """
        while True:
            lock = self._lock
            if not lock.acquire(blocking=False) or lock is not self._lock:
                lock = self._enter()
            self._thread_id, self._worker = threading.get_ident(), worker
            try:
                pipeline = self.pipeline
                route = pipeline.route(key)
                event = pipeline.run(route, now, message=message, arrival=arrival, segment=segment, targets=targets)
                return event, pipeline.outcome(event, route)
            except AbandonedError:
                if worker is not None:
                    raise
            finally:
                lock.release()

    def change(self, action: Callable[[Pipeline], None]) -> None:
        """Call a function on the pipeline while no thread feeds it; repeat it if an interceptor blocks meanwhile."""
        while True:
            lock = self._enter()
            self._thread_id, self._worker = threading.get_ident(), None
            try:
                action(self.pipeline)
                return
            except AbandonedError:
                continue
            finally:
                lock.release()

    def call(self, stage: Stage, hook: str, *arguments: object, worker: PipelineWorker) -> None:
        """Call a method of an interceptor, such as `joined`, unless the interceptor was removed.

        Raises:
            AbandonedError: The method blocked, and `worker` continues on a new thread.
        """
        lock = self._enter()
        self._thread_id, self._worker = threading.get_ident(), worker
        try:
            if any(each.interceptor is stage.interceptor for each in self.pipeline.stages):
                self.pipeline.call(stage, hook, *arguments)
        finally:
            lock.release()

    def rewriter(self, key: str, payload: bytes) -> Callable[[bytes], bytes] | None:
        """Return the result of `Pipeline.rewriter`; None also if an interceptor raises or blocks there."""
        found: list[Callable[[bytes], bytes]] = []

        def ask(pipeline: Pipeline) -> None:
            function = pipeline.rewriter(key, payload)
            if function is not None:
                found.append(function)

        try:
            self.change(ask)
        except Exception:
            _LOG.exception("interceptors of %s cannot say what they make of payloads", key)
        return found[0] if found else None

    def rewrote(self, key: str, count: int) -> None:
        """Count messages as `Pipeline.rewrote` does."""
        self.change(lambda pipeline: pipeline.rewrote(key, count))

    def replace(self, interceptors: Sequence[object]) -> None:
        """Replace the interceptors from the next message on; raises ConfigError if they are not usable."""
        self.change(lambda pipeline: pipeline.replace(interceptors))

    def _enter(self) -> threading.Lock:
        while True:
            lock = self._lock
            if not (lock.acquire(blocking=False) or lock.acquire(timeout=0.1)):
                continue
            if lock is self._lock:
                return lock
            lock.release()  # its former worker was stuck, and the lock was replaced

    def _watching(self) -> None:
        asked: list[Stage] = []
        since = time.monotonic()
        while not self._stop.wait(self._budget_s / 4):
            current = self.pipeline.current
            if current is not asked or not current:
                asked, since = current, time.monotonic()
            elif time.monotonic() - since >= self._budget_s:
                self._free(asked)

    def _free(self, asked: list[Stage]) -> None:
        pipeline, worker = self.pipeline, self._worker
        try:
            stage = asked[0]
        except IndexError:
            return
        place = stage.place_of_frame(sys._current_frames().get(self._thread_id))
        reason = f"blocked for more than {self._budget_s:g} s; it is bypassed from now on"
        if not pipeline.abandon(asked, reason, place):
            return
        _LOG.warning("interceptor %s (%s) %s", stage.name, place, reason)
        self._lock = threading.Lock()
        if worker is not None:
            worker.take_over()


def end_interceptors(pipeline: Pipeline, *, patience_s: float = 10.0) -> None:
    """Call every interceptor's `stop` with a time limit; call this when no thread feeds the pipeline.

    Args:
        pipeline: Pipeline of the interceptors to end.
        patience_s: Time limit of each, in seconds; longer than for a message, since it may have to finish a file.
    """

    def close() -> None:
        with suppress(AbandonedError):
            pipeline.close()

    while True:
        thread = threading.Thread(target=close, name="riot-end", daemon=True)
        thread.start()
        thread.join(patience_s)
        if not thread.is_alive():
            return
        asked = pipeline.current
        for stage in asked[:1]:
            place = stage.place_of_frame(sys._current_frames().get(thread.ident or 0))
            reason = f"did not stop within {patience_s:g} s"
            if pipeline.abandon(asked, reason, place):
                _LOG.warning("interceptor %s (%s) %s", stage.name, place, reason)
