"""The thread that brings the messages of one key expression from Zenoh to the sink.

Messages are fetched in batches, since a full Zenoh channel wakes its sender for each single message that is fetched.
What all messages of a key have in common is determined once.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections import Counter
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any

from riot_bus.log.engine.blocks import TIMES
from riot_bus.pipeline.runner import MOST_TOPICS, BoundedCounts
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.batches import LARGEST_BATCH
from riot_bus.zenoh.convert import Converter, is_delete
from riot_bus.zenoh.key_table import KeyTable, KnownKey

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator

    from riot_bus.log.engine.chunk import Row
    from riot_bus.log.gaps import Gaps
    from riot_bus.log.layout import Constants
    from riot_bus.log.log_channels import ChannelWriter
    from riot_bus.record.recording_sink import RecordingSink
    from riot_bus.types.capabilities import Stamp
    from riot_bus.zenoh.batches import Batches

_LOG = logging.getLogger(__name__)
_MOST_FETCHED = 10_000  # timestamps of a key, 1 to 2 MB: a cache may send any number
_TAKE = attrgetter(
    "key_expr",
    "payload",
    "encoding",
    "priority",
    "congestion_control",
    "express",
    "attachment",
    "timestamp",
    "source_info",
)


class KeyRules:
    """Rules for the messages of one key.

    Attributes:
        stamp: Function that reads attachments; None if they say nothing.
        least_ns: Least time between two recorded messages, nanoseconds; 0 to record all.
        trigger: Function that gets each message; None if there is none.
    """

    __slots__ = ("choosy", "due", "fetched", "first", "least_ns", "stamp", "topic", "trigger")

    def __init__(
        self,
        topic: str,
        *,
        stamp: Callable[[bytes], Stamp | None] | None = None,
        least_ns: int = 0,
        trigger: Callable[[bytes, str], None] | None = None,
    ) -> None:
        self.topic, self.stamp, self.least_ns, self.trigger = topic, stamp, least_ns, trigger
        self.choosy = trigger is not None or least_ns > 0
        self.due = 0
        self.first: Any = None  # Zenoh timestamp of the first message that was not fetched
        self.fetched: set[str] | None = None  # timestamps of messages that were fetched from a cache


class _KeyRoute(KnownKey):
    """What is known of one key, with its track in the present file."""

    def __init__(self, key: str, sample: Any, track: ChannelWriter | None, rules: KeyRules) -> None:
        super().__init__(key, sample)
        self.rules = rules
        self.number = -1 if track is None else track.number
        self.constants: Constants | None = None if track is None else track.constants
        self.patient = False


class RecordingSubscriber:
    """Subscriber that records; one per key expression."""

    def __init__(
        self,
        batches: Batches,
        expression: str,
        *,
        sink: RecordingSink,
        gaps: Gaps,
        owner: Callable[[str], str | None],
        rules: Callable[[str], KeyRules | None],
        paused: Callable[[], bool],
        sequence: Iterator[int],
    ) -> None:
        self.expression = expression
        self.flows = BoundedCounts()
        """Messages so far by key."""
        self._sink, self._gaps, self._owner, self._rules = sink, gaps, owner, rules
        self._paused, self._sequence = paused, sequence
        self._convert = Converter("", itertools.count())
        self._generation = -1
        self._numbers: dict[int, _KeyRoute] = {}
        self._keys = KeyTable(self._learn, most=MOST_TOPICS)
        self._known: dict[str, KeyRules | None] = {}
        self._batches = batches
        self._thread = threading.Thread(target=self._run, name="riot-subscriber", daemon=True)
        self._thread.start()

    def senders(self) -> dict[str, set[str]]:
        """Return the ids in the Zenoh timestamps of messages, by key."""
        return self._keys.senders()

    def close(self) -> None:
        """Stop receiving, and record what has come in; safe to call twice."""
        self._batches.close()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def put(self, samples: list[Any]) -> None:
        """Record those samples from the cache of a publisher that were not received directly."""
        with self._sink.lock:
            new = []
            for sample in samples:
                rules, stamp = self._rules_of(str(sample.key_expr)), sample.timestamp
                if rules is None or stamp is None or (rules.first is not None and stamp >= rules.first):
                    continue
                rules.fetched = rules.fetched or set()
                if str(stamp) not in rules.fetched and len(rules.fetched) < _MOST_FETCHED:
                    rules.fetched.add(str(stamp))
                    new.append(sample)
            for start in range(0, len(new), LARGEST_BATCH):  # not all payloads are copied at once
                self._slice(new[start : start + LARGEST_BATCH], fetched=True)

    def _run(self) -> None:
        while samples := self._batches.receive():
            try:
                self._slice(samples)
            except Exception:  # whatever it is, the next messages are recorded
                _LOG.exception("messages of %s are lost", self.expression)
                with self._sink.lock:
                    self._sink.counts.lose("damaged", self.expression, len(samples))

    def _slice(self, samples: list[Any], *, fetched: bool = False) -> None:
        sink = self._sink
        with sink.lock:
            if self._generation != sink.generation:
                self._generation = sink.generation
                self._keys.forget()
                self._numbers.clear()
            try:
                rows, patient = self._rows(samples, fetched=fetched)
            except Exception:
                _LOG.exception("a message of %s could not be read", self.expression)
                rows, patient = self._one_by_one(samples)
            if rows:
                for number, count in Counter(map(itemgetter(0), rows)).items():
                    route = self._numbers[number]
                    sink.counts.recorded.add(route.rules.topic, count)
                    self.flows.add(route.key, count)
                sink.append(rows, patient=patient)
        first = self._keys.known.get(samples[0].key_expr)
        if first is not None:
            self._keys.note_sender(first.key, samples[0])

    def _one_by_one(self, samples: list[Any]) -> tuple[list[Row], bool]:
        """Return the rows of the samples that can be read, and count the others."""
        found: list[Row] = []
        for sample in samples:
            try:
                found += self._rows([sample])[0]
            except Exception:
                self._sink.counts.lose("damaged", self.expression)
        return found, True

    def _rows(self, samples: list[Any], *, fetched: bool = False) -> tuple[list[Row], bool]:
        """Return what is to be written, and whether a slow disk may hold up the publishers."""
        rows: list[Row] = []
        put, take, routes, clock, number_of = (
            rows.append,
            _TAKE,
            self._keys.known,
            time.time_ns,
            self._sequence.__next__,
        )
        paused, patient, origin, see = self._paused(), False, self._origin, None if fetched else self._gaps.see
        for sample in samples:
            key, content, encoding, priority, congestion, express, attached, stamp, info = take(sample)
            try:
                route = routes[key]
            except KeyError:
                route = self._keys.learn(key, sample)
                routes = self._keys.known
            if route is None:
                continue
            now, payload, rules = clock(), content.to_bytes(), route.rules
            extras: dict[str, Any] | None = None
            sequence = published = None
            if attached is not None or info is not None:
                sequence, published, extras = origin(route, attached, info, see)
            if stamp is not None:
                if not fetched and (rules.first is None or rules.fetched is not None) and _came_before(rules, stamp):
                    continue
                if published is None:
                    published = stamp.get_time_as_ntp64().as_nanos()
            if (paused or rules.choosy) and not self._is_chosen(route, payload, now, paused=paused):
                continue
            if route.number < 0:  # there is no room for its key in the file
                self._sink.counts.lose("refused", rules.topic)
                continue
            if not (
                express is route.express
                and priority == route.priority
                and congestion == route.congestion
                and encoding == route.encoding
            ):
                extras = self._different(sample, route, extras)
            patient = patient or route.patient
            if not payload and is_delete(sample):
                extras = {**(extras or {}), "d": True}
            if published is None:
                published = now
            elif published == now or not 0 <= published < TIMES:
                extras = {**(extras or {}), "p": str(published)}
                published = now
            if sequence is None:
                sequence = number_of()
            if not 0 <= sequence < 1 << 32:
                extras = {**(extras or {}), "n": sequence}
            put((route.number, sequence & 0xFFFFFFFF, now, published, payload, extras))
        return rows, patient

    def _origin(
        self, route: _KeyRoute, attached: Any, info: Any, see: Callable[[Hashable, int], int] | None
    ) -> tuple[int | None, int | None, dict[str, Any] | None]:
        """Return number and time that the publisher gave, and extras; count the numbers that are missing."""
        sequence = published = extras = None
        publisher: Hashable = None
        if attached is not None:
            attachment = attached.to_bytes()
            extras = {"a": attachment}
            stamp = route.rules.stamp
            if stamp is not None and (said := stamp(attachment)) is not None:
                sequence, published, publisher = said
        if info is not None and sequence is None:
            source, sequence = info.source_id, info.source_sn
            publisher = str(source.zid), source.eid
        if sequence is not None and see is not None and (missed := see((route.key, publisher), sequence)):
            self._sink.counts.lose("missed", route.rules.topic, missed)
        return sequence, published, extras

    def _is_chosen(self, route: _KeyRoute, payload: bytes, now: int, *, paused: bool) -> bool:
        """Show a message to the trigger; return whether it is recorded, and count it if it is not."""
        rules, left_out = route.rules, self._sink.counts.left_out
        if rules.trigger is not None:
            rules.trigger(payload, route.key)
        if paused:
            left_out["paused"].add(rules.topic)
            return False
        if now < rules.due:
            left_out["throttled"].add(rules.topic)
            return False
        if rules.least_ns:
            rules.due = (rules.due if rules.due > now - rules.least_ns else now) + rules.least_ns
        return True

    def _different(self, sample: Any, route: _KeyRoute, extras: dict[str, Any] | None) -> dict[str, Any] | None:
        """Add what differs from the channel's first message."""
        from riot_bus.log.layout import extras_of

        assert route.constants is not None
        found = extras_of(self._convert.at(sample, 0), route.constants) or {}
        found = {name: found[name] for name in ("e", "q") if name in found}
        return {**(extras or {}), **found} or None

    def _learn(self, key: str, sample: Any) -> _KeyRoute | None:
        if len(self._known) >= MOST_TOPICS:
            self._known.clear()
        rules = self._rules_of(key)
        if rules is None:
            return None
        message: Message = self._convert.at(sample, 0)
        route = _KeyRoute(key, sample, self._sink.writer.track(message), rules)
        if route.constants is not None:
            # The channel may have been opened by a message with other settings.
            qos, text = route.constants.qos, route.constants.encoding
            route.patient = message.qos.congestion != "drop"
            if (message.qos, message.encoding) != (qos, text):
                route.encoding = None
        self._numbers[route.number] = route
        self._keys.note_sender(key, sample)
        return route

    def _rules_of(self, key: str) -> KeyRules | None:
        try:
            return self._known[key]
        except KeyError:
            rules = self._known[key] = self._rules(key) if self._owner(key) == self.expression else None
            return rules


def _came_before(rules: KeyRules, stamp: Any) -> bool:
    """Return whether a message was fetched from a cache before it was received."""
    if rules.first is None:
        rules.first = stamp
    return rules.fetched is not None and str(stamp) in rules.fetched
