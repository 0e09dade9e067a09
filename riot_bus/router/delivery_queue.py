"""The path of intercepted messages from their source segment through the pipeline to the target segments."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import BoundedCounts, Emission, Result

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.pipeline.event import Arrival
    from riot_bus.router.advanced.publisher_state import PublisherState
    from riot_bus.router.pipeline_executor import PipelineExecutor, PipelineWorker
    from riot_bus.router.surroundings import BusAccess, Surroundings
    from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)


class PipelineAnswer(NamedTuple):
    """What becomes of a received message that the pipeline has processed.

    Attributes:
        payload: New payload with which to forward it at once; None to forward it as it came.
        result: All that has to be delivered instead; None if it is to be forwarded.
    """

    payload: bytes | None = None
    result: Result | None = None


_PASS = PipelineAnswer()


class Treatment(NamedTuple):
    """How the messages of one key are processed.

    Attributes:
        inspected: Whether the pipeline or the recorder has to see them.
        advanced: Whether the key has advanced publishers, which makes them inspected, too.
        rewrite: Function that does all that the interceptors do to a payload, if there is such a function.
    """

    inspected: bool
    advanced: bool = False
    rewrite: Callable[[bytes], bytes] | None = None


class DeliveryQueue:
    """Runs messages through the pipeline and publishes the results when they are due.

    The thread that brought a message publishes what is due at once, so a slow receiver holds up its senders, as in a
    plain router; a separate thread publishes what is due later.
    """

    def __init__(
        self,
        executor: PipelineExecutor,
        access: BusAccess,
        surroundings: Surroundings,
        *,
        topic: Callable[[str], str],
    ) -> None:
        self.executor, self.access, self.surroundings = executor, access, surroundings
        self._surrounding = threading.Lock()
        self._topic = topic
        self._delayed = EmissionQueue()
        self._held: Counter[str] = Counter()
        self._condition = threading.Condition()
        self._lost: dict[str, BoundedCounts] = {}
        self._lost_lock = threading.Lock()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="riot-delayed", daemon=True)

    def surround(self, **changes: Any) -> None:
        """Replace some of the surroundings, from the next message on."""
        with self._surrounding:
            self.surroundings = replace(self.surroundings, **changes)

    def observe(self, segment: str) -> None:
        """Consider from now on that a subscriber in this process listens to a segment."""
        with self._surrounding:
            self.surroundings = replace(self.surroundings, observed=self.surroundings.observed | {segment})

    def owner(self, key: str) -> str | None:
        """Return which intercepted expression a key belongs to, if any."""
        return self.surroundings.claims.owner(key)

    def start(self) -> None:
        """Start the thread for delayed messages, unless it was started."""
        if self._thread.ident is None:
            self._thread.start()

    def close(self) -> None:
        """End the thread; what is still held is counted as lost. Safe to call twice."""
        with self._condition:
            self._closing = True
            self._condition.notify()
        self.give_up()
        if self._thread.is_alive():
            self._thread.join()
        for outlets in self.access.outlets.values():
            outlets.close()

    def give_up(self) -> None:
        """Discard the messages that are still held, and count them as lost."""
        with self._condition:
            left = self._delayed.pop_due()
        for emission in left:
            self.lose(emission.counted_key, "held at the end")
            self._unhold(emission)

    def held(self) -> Counter[str]:
        """Return, by topic, how many messages wait until they are due."""
        with self._condition:
            return +self._held

    def treatment(self, key: str, payload: Callable[[], bytes], *, advanced: bool) -> Treatment:
        """Return how the messages of a key are processed."""
        wanted, recorded = bool(self.executor.pipeline.route(key).stages), self.surroundings.recorder is not None
        if recorded or advanced or not wanted:
            return Treatment(recorded or advanced or wanted, advanced)
        return Treatment(inspected=True, rewrite=self.executor.rewriter(key, payload()))

    def send(self, message: Message, worker: PipelineWorker | None = None) -> None:
        """Take a whole message of this process through the pipeline and deliver it; see `result`."""
        self.deliver(self.result(message, worker))

    def replay(self, message: Message, worker: PipelineWorker) -> Result:
        """Take a message of a history through the pipeline, to be stored rather than published.

        Messages that interceptors add on other keys are published, since no cache stores those.
        """
        result = self.result(message, worker)
        for emission in result.emissions:
            if emission.message.key != message.key:
                self._publish(emission)
        kept = tuple(each for each in result.emissions if each.message.key == message.key)
        return Result(message, kept, result.changes, result.dropped)

    def record(self, result: Result) -> None:
        """Record a result of `replay`, once its message is published live."""
        self.record_original(result)
        if (recorder := self.surroundings.recorder) is not None:
            for emission in result.emissions:
                recorder.delivered(emission.message, emission.changes)

    def record_original(self, result: Result) -> None:
        """Record the message that came in, if it was changed."""
        recorder = self.surroundings.recorder
        if recorder is not None and result.changes:
            recorder.original(result.original, result.changes)

    def record_delivered(self, emission: Emission, message: Message) -> None:
        """Record what was published of an emission, at the time when it was due."""
        recorder = self.surroundings.recorder
        if recorder is not None:
            late = message.with_(time=emission.due) if emission.due > message.time else message
            recorder.delivered(late, emission.changes)

    def result(self, message: Message, worker: PipelineWorker | None, targets: tuple[str, ...] | None = None) -> Result:
        """Take a whole message through the pipeline, without delivering the result.

        Args:
            message: The received message.
            worker: Worker that is notified if its thread gets stuck; see `PipelineExecutor.feed`.
            targets: Target segments; by default all others.
        """
        event, result = self.executor.feed(
            message.key,
            message.time,
            message=message,
            segment=message.segment,
            targets=self.access.targets.get(message.segment, ()) if targets is None else targets,
            worker=worker,
        )
        if result is None:
            changes = tuple(event.changes)
            result = Result(message, (Emission(message.time, event.message, message, changes),), changes)
        return result

    def feed(self, key: str, arrival: Arrival, worker: PipelineWorker) -> PipelineAnswer:
        """Run a received message through the pipeline; the caller forwards it, or delivers the answer's result."""
        segment = arrival.segment
        event, result = self.executor.feed(
            key, arrival.time, arrival=arrival, segment=segment, targets=self.access.targets[segment], worker=worker
        )
        if result is not None:
            return PipelineAnswer(None, result)
        answer = PipelineAnswer(event.new_payload) if event.touched else _PASS  # before the recorder decodes it
        recorder = self.surroundings.recorder
        if recorder is not None:
            if event.changes:
                recorder.original(event.original, event.changes)
            recorder.delivered(event.message, event.changes)
        return answer

    def deliver(self, result: Result) -> None:
        """Record the original of what was changed, publish what is due, and keep the rest."""
        self.record_original(result)
        now = time.time_ns()
        for emission in result.emissions:
            if emission.due <= now:
                self._publish(emission)
            else:
                with self._condition:
                    self._delayed.push(emission)
                    self._held[self._topic(emission.counted_key)] += 1
                    self._condition.notify()

    def lose(self, key: str, reason: str) -> None:
        """Count a message that is not delivered."""
        with self._lost_lock:
            self._lost.setdefault(reason, BoundedCounts()).add(self._topic(key))

    def not_published(self, key: str, error: Exception) -> None:
        """Count and report a message that could not be forwarded."""
        _LOG.warning("a message of %s could not be forwarded: %s", key, error)
        self.lose(key, "not published")

    def losses(self) -> dict[str, Counter[str]]:
        """Return how many messages were unintentionally not delivered, by reason and topic."""
        with self._lost_lock:
            return {reason: Counter(topics) for reason, topics in self._lost.items()}

    def targets_of(self, emission: Emission) -> tuple[str, ...]:
        """Return the segments in which to publish a message."""
        message, targets = emission.message, emission.targets
        if targets is None:
            source = (emission.original or message).segment
            targets = self.access.targets.get(source) or tuple(self.access.outlets)
        # an added message on a key that is not cut reaches the others by itself
        return targets if self.owner(message.key) is not None else targets[:1]

    def _publish(self, emission: Emission) -> None:
        stream_of = self.surroundings.stream_of
        state = None if stream_of is None else stream_of(emission.original, emission.message)
        if state is None:
            self._put(emission)
        else:
            state.deliver(emission.message.key, partial(self._put, emission, state))

    def _put(self, emission: Emission, state: PublisherState | None = None) -> None:
        message = emission.message
        if emission.original is None:
            message = message.with_(sequence=next(self.access.sequence))
        try:
            for name in self.targets_of(emission):
                if state is None or not state.publish(name, message):
                    self.access.outlets[name].publish(message)
        except Exception:
            _LOG.exception("a message of %s could not be published", message.key)
            self.lose(emission.counted_key, "not published")
            return
        self.record_delivered(emission, message)

    def _unhold(self, emission: Emission) -> None:
        topic = self._topic(emission.counted_key)
        with self._condition:
            self._held[topic] -= 1
            if not self._held[topic]:
                del self._held[topic]  # else ever new keys would exhaust the memory

    def _run(self) -> None:
        while True:
            with self._condition:
                if self._closing:
                    return
                due = self._delayed.next_due()
                now = time.time_ns()
                if due is None or due > now:
                    self._condition.wait(None if due is None else min(threading.TIMEOUT_MAX, (due - now) / 1e9))
                ready = self._delayed.pop_due(time.time_ns())
            for emission in ready:
                self._publish(emission)
                self._unhold(emission)
