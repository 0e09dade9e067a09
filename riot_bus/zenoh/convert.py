"""Conversion of Zenoh's samples to messages and back."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import zenoh

_CONGESTION = ("drop", "block", "block_first")  # by Zenoh's numbers
_PRIORITIES = ("REAL_TIME", "INTERACTIVE_HIGH", "INTERACTIVE_LOW", "DATA_HIGH", "DATA", "DATA_LOW", "BACKGROUND")
_DEFAULT_ENCODING = "zenoh/bytes"
_CACHED_PUBLISHERS = 4096  # each is declared at Zenoh, too; components may invent keys without end
_CACHED_KEYS = 1 << 16  # components may invent keys: about 10 MB of short ones, then it starts anew

FEW = 2
"""Number of messages of a key that are published without declaring a publisher."""


class Converter:
    """Turns the samples of one segment into messages.

    Args:
        segment: Name of the segment, empty if unknown.
        sequence: Gives each message its number; shared by all converters of a bus.
    """

    def __init__(self, segment: str, sequence: Iterator[int]) -> None:
        self.segment = segment
        self._sequence = sequence
        self._qos: dict[tuple[int, int, bool], Qos] = {}

    def __call__(self, sample: zenoh.Sample) -> Message:
        """Return the message that the sample carries; its time is now."""
        return self.at(sample, time.time_ns())

    def at(self, sample: zenoh.Sample, now: int) -> Message:
        """Return the message that the sample carries.

        Args:
            sample: A received sample.
            now: Time of reception, in nanoseconds since the Unix epoch.
        """
        encoding = str(sample.encoding)
        attachment = sample.attachment
        return Message(
            now,
            str(sample.key_expr),
            sample.payload.to_bytes(),
            "delete" if is_delete(sample) else "put",
            "" if encoding == _DEFAULT_ENCODING else encoding,
            None if attachment is None else attachment.to_bytes(),
            self.qos(sample),
            self.segment,
            next(self._sequence),
        )

    def qos(self, sample: zenoh.Sample) -> Qos:
        """Return the delivery settings of a sample."""
        raw: Any = sample  # the stubs know nothing of the enums' numbers
        code = (int(raw.priority), int(raw.congestion_control), raw.express)
        qos = self._qos.get(code)
        if qos is None:
            qos = self._qos[code] = Qos(code[0], _CONGESTION[code[1]], code[2])  # type: ignore[arg-type]
        return qos


class SampleArrival:
    """A received sample that is converted only on demand, since most messages pass unchanged (`pipeline.Arrival`).

    Args:
        time: Time of reception, in nanoseconds since the Unix epoch.
    """

    __slots__ = ("_converter", "_message", "_payload", "_sample", "key", "segment", "time")

    def __init__(self, sample: zenoh.Sample, key: str, time: int, converter: Converter) -> None:
        self._sample, self._converter = sample, converter
        self._message: Message | None = None
        self._payload: bytes | None = None
        self.key, self.time, self.segment = key, time, converter.segment

    def payload(self) -> bytes:
        """Return the payload."""
        if self._payload is None:
            self._payload = self._sample.payload.to_bytes()
        return self._payload

    def message(self) -> Message:
        """Return the message; the same object each time."""
        if self._message is None:
            self._message = self._converter.at(self._sample, self.time)
        return self._message


def is_delete(sample: zenoh.Sample) -> bool:
    """Return whether a sample is a delete."""
    kind: Any = sample.kind
    return int(kind) != 0


def is_droppable(sample: zenoh.Sample) -> bool:
    """Return whether a sample may be dropped when its receivers are slow."""
    congestion: Any = sample.congestion_control
    return int(congestion) == 0


class Occasional:
    """Publishes on a key that may not be used again, without declaring a publisher.

    Declaring a publisher takes far longer than publishing, and longer the more publishers there are: a component that
    keeps inventing keys would delay all others.
    """

    __slots__ = ("_encoding", "_key", "_qos", "_session")

    def __init__(self, session: zenoh.Session, key: str, qos: Mapping[str, Any], encoding: str | None) -> None:
        self._session, self._key, self._qos, self._encoding = session, key, qos, encoding

    def put(self, payload: Any, *, encoding: zenoh.Encoding | str | None = None, attachment: Any = None) -> None:
        """Publish as a publisher does."""
        encoding = self._encoding if encoding is None else encoding
        self._session.put(self._key, payload, encoding=encoding, attachment=attachment, **self._qos)

    def delete(self, *, attachment: Any = None) -> None:
        """Delete as a publisher does."""
        self._session.delete(self._key, attachment=attachment, **self._qos)


class Outlets:
    """Publishes messages into one session, through publishers declared once for each recurring key and QoS.

    Neither Zenoh's timestamp nor its source information is set: advanced subscribers drop messages in which these do
    not increase, so copies, delays and replays would be lost. The session adds timestamps itself.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._library = library_of(session)
        self._publishers: dict[tuple[str, Qos], zenoh.Publisher] = {}
        self._times: Counter[tuple[str, Qos]] = Counter()
        self._encodings: dict[str, zenoh.Encoding] = {}
        self._memory: Any = None
        self.longest_s = 0.0
        """Longest time that one publication took."""

    def publish(self, message: Message) -> None:
        """Put or delete; raise zenoh.ZError if the session is closed."""
        publisher = self._publishers.get((message.key, message.qos)) or self._seldom(message.key, message.qos)
        began = time.monotonic()
        if message.kind == "delete":
            publisher.delete(attachment=message.attachment)
        else:
            publisher.put(message.payload, encoding=self.encoding(message.encoding), attachment=message.attachment)
        self.took(time.monotonic() - began)

    def took(self, seconds: float) -> None:
        """Take note of how long a publication took."""
        if seconds > self.longest_s:
            self.longest_s = seconds

    def publisher(self, key: str, qos: Qos, encoding: zenoh.Encoding | str | None = None) -> zenoh.Publisher:
        """Return the publisher of a key; declare it if necessary."""
        known = self._publishers.get((key, qos))
        if known is not None:
            return known
        pin(self._session, key)
        publisher = self._session.declare_publisher(key, encoding=encoding, **publisher_settings(qos, self._library))
        if len(self._publishers) >= _CACHED_PUBLISHERS:
            self._publishers.clear()  # they undeclare themselves
        self._publishers[key, qos] = publisher
        return publisher

    def close(self) -> None:
        """Undeclare all publishers."""
        self._publishers.clear()  # they undeclare themselves

    def occasional(self, key: str, qos: Qos, encoding: str) -> zenoh.Publisher | Occasional:
        """Return the publisher of a key if it is declared, otherwise an `Occasional`."""
        return self._publishers.get((key, qos)) or self._occasional(key, qos, encoding)

    def _seldom(self, key: str, qos: Qos) -> zenoh.Publisher | Occasional:
        self._times[key, qos] += 1
        if self._times[key, qos] <= FEW:
            if len(self._times) > _CACHED_PUBLISHERS:
                self._times.clear()
            return self._occasional(key, qos, None)
        del self._times[key, qos]
        return self.publisher(key, qos)

    def _occasional(self, key: str, qos: Qos, encoding: str | None) -> Occasional:
        return Occasional(self._session, key, publisher_settings(qos, self._library), encoding)

    def shared(self, payload: bytes) -> Any:
        """Return a payload in shared memory; the payload itself if it is empty or no such memory is available."""
        if not payload:
            return payload
        try:
            if self._memory is None:
                self._memory = self._library.shm.ShmProvider.default_backend(1 << 26)  # only what is used takes memory
            buffer = self._memory.alloc(len(payload), self._library.shm.GarbageCollect())
        except self._library.ZError:
            return payload
        buffer[:] = payload
        return buffer

    def encoding(self, text: str) -> zenoh.Encoding:
        """Return Zenoh's object for an encoding string."""
        known = self._encodings.get(text)
        if known is not None:
            return known
        if len(self._encodings) >= _CACHED_PUBLISHERS:
            self._encodings.clear()
        encoding: zenoh.Encoding = self._library.Encoding(text or _DEFAULT_ENCODING)
        self._encodings[text] = encoding
        return encoding


def publisher_settings(qos: Qos, library: Any) -> dict[str, Any]:
    """Return these delivery settings as arguments for declaring a publisher with a copy of Zenoh's library."""
    return {
        "priority": getattr(library.Priority, _PRIORITIES[qos.priority - 1]),
        "congestion_control": getattr(library.CongestionControl, qos.congestion.upper()),
        "express": qos.express,
    }


class Claims:
    """Determines which key expression owns a key: the first that matches, so that no message is taken twice.

    Args:
        expressions: Canonical key expressions; they may overlap.
        owners: Key expressions that can own keys; by default the same.
        within: Other claims; keys that have no owner in them have none here either.
    """

    def __init__(
        self, expressions: Sequence[str], *, owners: Sequence[str] | None = None, within: Claims | None = None
    ) -> None:
        import zenoh

        self.expressions = list(expressions)
        self._within = within
        self._parsed = [zenoh.KeyExpr(text) for text in self.expressions]
        self._able = [(text, zenoh.KeyExpr(text)) for text in (self.expressions if owners is None else owners)]
        self._owners: dict[str, str | None] = {}

    def owner(self, key: str) -> str | None:
        """Return the key expression that owns a key, None if there is none."""
        try:
            return self._owners[key]
        except KeyError:
            owner = None
            if any(expression.includes(key) for expression in self._parsed):
                owner = next((text for text, expression in self._able if expression.includes(key)), None)
            if self._within is not None and self._within.owner(key) is None:
                owner = None
            if len(self._owners) >= _CACHED_KEYS:
                self._owners.clear()
            self._owners[key] = owner
            return owner
