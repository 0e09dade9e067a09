"""A ramp: takes messages that the router's own process puts on a segment through the pipeline to the other segments.

A ramp serves a bridge in this process as lanes serve components elsewhere. Between processes a message passes several
threads and two sockets; here it passes none of them, unless interceptors do more to it than a pure function does.
"""

from __future__ import annotations

import itertools
import logging
import queue
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.pipeline.runner import AbandonedError
from riot_bus.router.audience import Audience
from riot_bus.router.counts import BoundedCounts
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from riot_bus.router.audience import Take
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.vocabulary.message import Qos
    from riot_bus.zenoh import api as zenoh

__all__ = ["IngressKey", "LocalIngress"]

_LOG = logging.getLogger(__name__)
_ROOM = 4096  # beyond it, senders wait; a larger queue adds delay, and its bytes have no limit
_TURN_S = 0.005  # how late `close` notices a replaced thread; a look costs microseconds


class IngressKey:
    """One key of a ramp; see `LocalIngress.track`. It is used by one thread at a time."""

    __slots__ = (
        "_ramp",
        "audiences",
        "generation",
        "key",
        "looked_at",
        "native",
        "passed",
        "puts",
        "qos",
        "rewrite",
        "rewritten",
        "seen",
        "takes",
        "text",
        "told",
    )

    def __init__(self, ramp: LocalIngress, key: str, qos: Qos, text: str) -> None:
        self._ramp = ramp
        self.key, self.qos, self.text = key, qos, text
        self.generation = -1
        self.native = self.looked_at = False
        self.rewrite: Callable[[bytes], bytes] | None = None  # all that interceptors do, if that is a function
        self.audiences: dict[str, Audience] = {}
        self.puts: list[Callable[[bytes, bytes | None], None]] = []
        self.takes: tuple[Take, ...] = ()
        self.passed = self.seen = self.rewritten = self.told = 0

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send a message to the other segments; waits if too many are queued, or receivers are slow."""
        self._ramp.put_all([self], [payload], attachment)

    def straight(self, payload: bytes) -> bytes | None:
        """Return the payload to forward, and count the message; None if an interceptor has to see the message."""
        rewrite = self.rewrite
        if rewrite is not None:
            try:
                payload = rewrite(payload)
            except Exception:  # reported when the interceptor processes the message
                return None
            self.rewritten += 1
        elif self.looked_at:
            return None
        else:
            self.passed += not self.native
        return payload

    def close(self) -> None:
        """Stop putting messages of the key; its counts stay."""
        self._ramp.end(self)
        for audience in self.audiences.values():
            audience.close()


class LocalIngress:
    """Takes messages from one segment to the others; keeps the order of the messages of each key.

    Interceptors run on a thread of the ramp's, which is abandoned to them if they block. Messages that pass unchanged
    or with a field set are sent on the thread that puts them, unless earlier ones are still on the ramp's thread.

    Args:
        segment: Name of the segment.
        crossing: Queue that takes messages through the pipeline and delivers them.
        sessions: The segments' own sessions.
        owner: Function that returns which intercepted expression a key belongs to.
        sequence: Sequence numbers of messages.

    Attributes:
        generation: Number that changes when what is known of keys may have changed.
        waiting: Queue of messages that interceptors have to see, or whose route is not known yet.
    """

    def __init__(
        self,
        segment: str,
        crossing: DeliveryQueue,
        sessions: Mapping[str, zenoh.Session],
        *,
        owner: Callable[[str], str | None],
        sequence: Iterator[int],
    ) -> None:
        self.segment = segment
        self._generations = itertools.count()
        self.generation = next(self._generations)
        self.waiting: queue.Queue[tuple[IngressKey, bytes, bytes | None] | None] = queue.Queue(_ROOM)
        self._crossing, self._sessions, self._owner, self._sequence = crossing, sessions, owner, sequence
        self._tracks: dict[int, IngressKey] = {}
        self._ended_passed, self._ended_flows = BoundedCounts(), BoundedCounts()
        self._telling, self._changing = threading.Lock(), threading.Lock()
        self._current: tuple[IngressKey, bytes, bytes | None] | None = None
        self._turn = 0
        self._thread = self._spawn()

    def track(self, key: str, qos: Qos, encoding: str) -> IngressKey:
        """Return an object that takes messages of a key.

        Args:
            key: Key without wildcards.
            qos: Delivery settings of all these messages.
            encoding: Zenoh's encoding string, empty for its default.
        """
        track = IngressKey(self, key, qos, encoding)
        with self._changing:
            self._tracks[id(track)] = track
        return track

    def put_all(self, tracks: Sequence[IngressKey], payloads: Sequence[bytes], attachment: bytes | None) -> None:
        """Send messages to the other segments; waits if too many are queued, or receivers are slow.

        Args:
            tracks: For each message, the track of its key.
            payloads: Payload of each message.
            attachment: Attachment of all the messages.
        """
        going: list[IngressKey] = []
        ready: list[tuple[bytes, bytes | None]] = []
        for track, payload in zip(tracks, payloads, strict=True):
            known = track.generation == self.generation and not self.waiting.unfinished_tasks
            changed = track.straight(payload) if known else None
            if going and (changed is None or (track.takes is not going[0].takes and track.takes != going[0].takes)):
                self._go(going, ready)
                going, ready = [], []
            if changed is None:
                self.waiting.put((track, payload, attachment))
            else:
                going.append(track)
                ready.append((changed, attachment))
        if going:
            self._go(going, ready)

    def owns(self, key: str) -> bool:
        """Return whether messages of a key go through this ramp; if not, they are routed natively."""
        return bool(self._crossing.targets[self.segment]) and self._owner(key) is not None

    def forget(self) -> None:
        """Forget what is known of keys, since interceptors, recorder or claims have changed."""
        self.generation = next(self._generations)

    def idle(self) -> bool:
        """Return whether no message is in the queue `waiting`, or being processed from it."""
        return not self.waiting.unfinished_tasks

    def passed(self) -> Counter[str]:
        """Return how many messages per key passed without inspection; report rewritten ones to the pipeline."""
        with self._changing:
            counts, tracks = Counter(self._ended_passed), list(self._tracks.values())
        for track in tracks:
            self.tell(track)
            if track.passed:
                counts[track.key] += track.passed
        return counts

    def flows(self) -> Counter[str]:
        """Return how many intercepted messages per key were received."""
        with self._changing:
            counts, tracks = Counter(self._ended_flows), list(self._tracks.values())
        for track in tracks:
            counts[track.key] += track.passed + track.seen + track.rewritten
        return +counts

    def tell(self, track: IngressKey) -> None:
        """Tell the pipeline how many messages of a key were rewritten."""
        with self._telling:
            count = track.rewritten - track.told
            track.told += count
        if count:
            self._crossing.gate.rewrote(track.key, count)

    def end(self, track: IngressKey) -> None:
        """Remove a track and keep only its counts."""
        self.tell(track)
        with self._changing:
            if self._tracks.pop(id(track), None) is not None:
                self._ended_passed.add(track.key, track.passed)
                self._ended_flows.add(track.key, track.passed + track.seen + track.rewritten)

    def close(self) -> None:
        """Forward the messages put so far, then end; safe to call twice."""
        if self._thread.is_alive():
            self.waiting.put(None)
            while self._thread.is_alive():  # in turns, since a stuck thread is replaced
                self._thread.join(_TURN_S)
        self.passed()

    def _go(self, tracks: Sequence[IngressKey], messages: list[tuple[bytes, bytes | None]]) -> None:
        """Give messages to the listeners in this process, which all the tracks share, then publish them."""
        for take in tracks[0].takes:
            take(messages)
        for track, message in zip(tracks, messages, strict=True):
            try:
                for put in track.puts:
                    put(*message)
            except Exception as error:
                _LOG.warning("a message of %s could not be forwarded: %s", track.key, error)
                self._crossing.lose(track.key, "not published")

    # -- on the ramp's thread -----------------------------------------------------------------------------------------

    def take_over(self) -> None:
        """Continue on a new thread, starting with the message on which the current one is stuck."""
        self._turn += 1
        self._thread = self._spawn()

    def flush(self) -> None:
        """Do nothing: everything is published at once."""

    def _spawn(self) -> threading.Thread:
        name = f"riot-ramp-{self.segment}"
        thread = threading.Thread(target=self._run, args=(self._turn,), name=name, daemon=True)
        thread.start()
        return thread

    def _run(self, turn: int) -> None:
        while turn == self._turn:
            item = self._current or self.waiting.get()
            if item is None:
                self.waiting.task_done()
                return
            self._current = item
            try:
                self._carry(*item)
            except AbandonedError:
                return
            except Exception:
                _LOG.exception("a message of %s was lost", item[0].key)
                self._crossing.lose(item[0].key, "failure of ours")
            self._current = None
            self.waiting.task_done()

    def _carry(self, track: IngressKey, payload: bytes, attachment: bytes | None) -> None:
        if track.generation != self.generation:
            self._learn(track, payload)
        changed = track.straight(payload)
        if changed is not None:
            self._go([track], [(changed, attachment)])
            return
        message = Message(
            time.time_ns(),
            track.key,
            payload,
            encoding=track.text,
            attachment=attachment,
            qos=track.qos,
            segment=self.segment,
            sequence=next(self._sequence),
        )
        self._crossing.send(message, self)
        track.seen += 1

    def _learn(self, track: IngressKey, payload: bytes) -> None:
        """Find out how to forward messages of a key."""
        self.tell(track)  # interceptors count the messages before this one
        generation, crossing, key = self.generation, self._crossing, track.key
        advanced = crossing.advanced is not None and key in crossing.advanced.keys
        wanted = crossing.recorder is not None or bool(crossing.gate.pipeline.route(key).stages)
        simple = wanted and not advanced and crossing.recorder is None
        track.native = not self.owns(key)
        track.looked_at = (wanted or advanced) and not track.native
        track.rewrite = crossing.gate.rewriter(key, payload) if simple and not track.native else None
        targets = () if track.native else crossing.targets[self.segment]
        track.puts = [put for name in targets for put in self._puts(track, name)]
        track.takes = tuple(take for name in targets for take in self._takes(key, name))
        track.generation = generation

    def _puts(self, track: IngressKey, name: str) -> list[Callable[[bytes, bytes | None], None]]:
        """Return the functions that publish on another segment."""
        crossing, key = self._crossing, track.key
        outlet = crossing.outlets[name]
        if name in crossing.observed:
            encoding = outlet.encoding(track.text)
            publisher = outlet.publisher(key, track.qos, encoding)

            def publish(payload: bytes, attachment: bytes | None) -> None:
                began = time.monotonic()
                try:
                    publisher.put(payload, encoding=encoding, attachment=attachment)
                finally:
                    outlet.took(time.monotonic() - began)

            return [publish]
        if name not in track.audiences:
            track.audiences[name] = Audience(
                self._sessions[name], key, qos=track.qos, encoding=track.text, took=outlet.took
            )
        return [track.audiences[name].put]

    def _takes(self, key: str, name: str) -> list[Take]:
        """Return the functions that give messages of a key to listeners in this process."""
        crossing = self._crossing
        if name in crossing.observed:
            return []
        return [each.take for each in crossing.inner.get(name, ()) if each.expression.includes(key)]
