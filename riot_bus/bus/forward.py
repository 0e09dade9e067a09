"""The thread that takes intercepted messages through the pipeline and publishes what comes out, when it is due."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Emission

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.bus.mailbox import Mailbox
    from riot_bus.bus.recorder import Recorder
    from riot_bus.message import Message
    from riot_bus.pipeline.runner import Pipeline

__all__ = ["Forwarder"]

_LOG = logging.getLogger(__name__)


class Forwarder:
    """Feeds the pipeline from a mailbox on one thread, which keeps the order of messages.

    Args:
        mailbox: Where messages arrive.
        pipeline: What is done to them.
        publish: Delivers one message to the other segments.
        recorder: Told about everything.
        sequence: Numbers for messages that interceptors add.
        lost: Called with a message that could not be delivered.
    """

    def __init__(
        self,
        mailbox: Mailbox[Message],
        pipeline: Pipeline,
        *,
        publish: Callable[[Message], None],
        recorder: Recorder | None,
        sequence: Iterator[int],
        lost: Callable[[Message], None],
    ) -> None:
        self.failures = 0
        """Number of messages that the pipeline itself failed on; they went on unchanged."""
        self._mailbox = mailbox
        self._pipeline = pipeline
        self._publish = publish
        self._recorder = recorder
        self._sequence = sequence
        self._lost = lost
        self._waiting = EmissionQueue()
        self._done = 0
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="riot-forward", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def idle(self) -> bool:
        """Return whether all accepted messages are through and no delayed one waits."""
        return self._done >= self._mailbox.accepted and not len(self._waiting)

    def close(self) -> None:
        """End the thread; what has not been delivered is counted as lost. Safe to call twice."""
        self._closing = True
        if self._thread.is_alive():
            self._mailbox.wake()
            self._thread.join()
        while (message := self._mailbox.take(0)) is not None:
            self._lost(message)
        for emission in self._waiting.pop_due():
            self._lost(emission.message)

    def _run(self) -> None:
        waiting = self._waiting
        while not self._closing:
            due = waiting.next_due()
            message = self._mailbox.take(None if due is None else max(0.0, (due - time.time_ns()) / 1e9))
            if message is not None:
                self._feed(message)
            if len(waiting):
                for emission in waiting.pop_due(time.time_ns()):
                    self._deliver(emission)
            if message is not None:
                self._done += 1

    def _feed(self, message: Message) -> None:
        try:
            result = self._pipeline.feed(message)
        except Exception:
            self.failures += 1
            _LOG.exception("the pipeline failed on a message of %s; it goes on unchanged", message.key)
            self._waiting.push(Emission(message.time, message, message))
            return
        if self._recorder is not None and result.changes:
            self._recorder.original(message, result.changes)
        self._waiting.push(*result.emissions)

    def _deliver(self, emission: Emission) -> None:
        message = emission.message
        if emission.original is None:
            message = message.with_(sequence=next(self._sequence))
        try:
            self._publish(message)
        except Exception:
            _LOG.exception("a message of %s could not be published", message.key)
            self._lost(message)
            return
        if self._recorder is not None:
            if emission.due != message.time:
                message = message.with_(time=emission.due)
            self._recorder.delivered(message, emission.changes)
