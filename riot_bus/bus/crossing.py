"""What happens to intercepted messages between the segment that they come from and those that they go to."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.bus.tally import Tally
from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Emission

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from riot_bus.bus.convert import Outlets
    from riot_bus.bus.gate import Gate, Holder
    from riot_bus.bus.recorder import Recorder
    from riot_bus.message import Message
    from riot_bus.pipeline.event import Arrival
    from riot_bus.pipeline.runner import Result

__all__ = ["Crossing"]

_LOG = logging.getLogger(__name__)
_IDLE_S = 3600.0


class Crossing:
    """Takes messages through the gate and publishes what comes out, when it is due.

    What is due at once is published by the thread that brought the message, so a slow receiver holds up those who send
    to it, as in a plain router; what is due later is published by a thread of its own.

    Args:
        gate: To the pipeline.
        outlets: Where to publish, by segment.
        targets: By segment, where its messages go to.
        owned: Says whether a key is intercepted.
        sequence: Numbers for messages that interceptors add.
        topic: Names the topic of a key.
    """

    def __init__(
        self,
        gate: Gate,
        outlets: Mapping[str, Outlets],
        *,
        targets: Mapping[str, tuple[str, ...]],
        owned: Callable[[str], bool],
        sequence: Iterator[int],
        topic: Callable[[str], str],
    ) -> None:
        self.gate = gate
        self.outlets = outlets
        self.targets = targets
        self.recorder: Recorder | None = None
        self._owned = owned
        self._sequence = sequence
        self._topic = topic
        self._waiting = EmissionQueue()
        self._held: Counter[str] = Counter()
        self._condition = threading.Condition()
        self._lost: dict[str, Tally] = {}
        self._lost_lock = threading.Lock()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="riot-delayed", daemon=True)

    def start(self) -> None:
        """Start the thread for delayed messages."""
        self._thread.start()

    def close(self) -> None:
        """End the thread; what is still held is counted as lost. Safe to call twice."""
        with self._condition:
            self._closing = True
            self._condition.notify()
            left = self._waiting.pop_due()
        if self._thread.is_alive():
            self._thread.join()
        for emission in left:
            self.lose(emission.message.key, "held at the end")
            self._unhold(emission)

    def held(self) -> Counter[str]:
        """Return how many messages wait until they are due, by topic."""
        with self._condition:
            return +self._held

    def send(self, message: Message) -> None:
        """Take a message of our own through the pipeline and deliver it."""
        event, result = self.gate.feed(
            message.key,
            message.time,
            message=message,
            segment=message.segment,
            targets=self.targets.get(message.segment, ()),
        )
        if result is not None:
            self.deliver(result)
        else:
            emission = Emission(message.time, event.message, message, tuple(event.changes))
            if event.changes and self.recorder is not None:
                self.recorder.original(message, event.changes)
            self._publish(emission)

    def feed(self, key: str, arrival: Arrival, holder: Holder) -> bytes | bool | None:
        """Take what arrived through the pipeline, and deliver what has to be taken apart.

        Returns:
            True if it shall pass as it came, a payload if it shall pass with this one, None if nothing is left to do.
        """
        segment = arrival.segment
        event, result = self.gate.feed(
            key, arrival.time, arrival=arrival, segment=segment, targets=self.targets[segment], holder=holder
        )
        if result is not None:
            holder.flush()  # what came before goes out before
            self.deliver(result)
            return None
        recorder = self.recorder
        if recorder is not None:
            if event.changes:
                recorder.original(event.original, event.changes)
            recorder.delivered(event.message, event.changes)
        return event.new_payload if event.touched else True

    def deliver(self, result: Result) -> None:
        """Record the original of what was changed, publish what is due, and keep the rest."""
        if self.recorder is not None and result.changes:
            self.recorder.original(result.original, result.changes)
        now = time.time_ns()
        for emission in result.emissions:
            if emission.due <= now:
                self._publish(emission)
            else:
                with self._condition:
                    self._waiting.push(emission)
                    self._held[self._topic(emission.message.key)] += 1
                    self._condition.notify()

    def lose(self, key: str, reason: str) -> None:
        """Count a message that is not delivered."""
        with self._lost_lock:
            self._lost.setdefault(reason, Tally()).add(self._topic(key))

    def losses(self) -> dict[str, Counter[str]]:
        """Return how many messages were not delivered against everybody's will, by reason and topic."""
        with self._lost_lock:
            return {reason: Counter(topics) for reason, topics in self._lost.items()}

    def _publish(self, emission: Emission) -> None:
        message = emission.message
        targets = emission.targets
        if targets is None:
            source = (emission.original or message).segment
            targets = self.targets.get(source) or tuple(self.outlets)
        if not self._owned(message.key):
            targets = targets[:1]  # an added message on a key that is not cut reaches the others by itself
        if emission.original is None:
            message = message.with_(sequence=next(self._sequence))
        try:
            for name in targets:
                self.outlets[name].publish(message)
        except Exception:
            _LOG.exception("a message of %s could not be published", message.key)
            self.lose(message.key, "not published")
            return
        if self.recorder is not None:
            if emission.due > message.time:
                message = message.with_(time=emission.due)
            self.recorder.delivered(message, emission.changes)

    def _unhold(self, emission: Emission) -> None:
        with self._condition:
            self._held[self._topic(emission.message.key)] -= 1

    def _run(self) -> None:
        while True:
            with self._condition:
                if self._closing:
                    return
                due = self._waiting.next_due()
                now = time.time_ns()
                if due is None or due > now:
                    self._condition.wait(_IDLE_S if due is None else (due - now) / 1e9)
                ready = self._waiting.pop_due(time.time_ns())
            for emission in ready:
                self._publish(emission)
                self._unhold(emission)
