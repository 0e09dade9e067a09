"""Faults in payloads: frozen, corrupt, cut, set, and with wrong stamps."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

from riot_bus.interceptors.per_topic import PerTopic
from riot_bus.pipeline.event import Change, Event
from riot_bus.types.elements import fit_value
from riot_bus.vocabulary.errors import ConfigError, PayloadError

_UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_FROZEN_BYTES = 1 << 28
_STATE_BYTES = 256
_MOST_ELEMENTS = 1 << 16
_SET_SINGLY = 8
"""Up to this many fields are set one by one, which records each; more are set at once, which is faster."""

_INDEX = re.compile(r"\[\d+\]")


class _Frozen(NamedTuple):
    payloads: dict[tuple[str, ...], bytes]
    """By target segments, because a message may have been changed before on its way to each of them."""
    first: int
    last: int

    def size(self) -> int:
        return sum(map(len, self.payloads.values())) + _STATE_BYTES


@dataclass
class Freeze:
    """Repeat the last value: selected messages carry the payload of the first one that was selected.

    A message that this does not see, because it is not selected or was dropped before, ends the repetition, and so does
    a delete; the next message is then repeated.

    Args:
        hold: For how many messages a value is repeated; 0 for as long as messages are selected.
    """

    name: ClassVar[str] = "freeze"
    hold: int = 0
    _frozen: PerTopic[_Frozen] = field(
        default_factory=lambda: PerTopic(most=_FROZEN_BYTES, size=_Frozen.size), init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.hold < 0:
            raise ConfigError(f"hold = {self.hold} is below 0")

    def message(self, event: Event) -> None:
        """Replace its payload."""
        if event.original.kind == "delete":
            return
        index, frozen = event.index, self._frozen.get(event.topic)
        if frozen is None or index - frozen.last not in (0, 1) or (self.hold and index - frozen.first > self.hold):
            frozen = _Frozen({}, index, index)
        payload = frozen.payloads.get(event.targets)
        payloads = frozen.payloads if payload is not None else {**frozen.payloads, event.targets: event.payload}
        self._frozen[event.topic] = _Frozen(payloads, frozen.first, index)
        if payload is not None and payload != event.payload:
            event.replace(payload)


@dataclass
class Corrupt:
    """Flip bits or replace bytes.

    Args:
        bits: Number of bits that are flipped.
        count: Number of bytes that are replaced, instead.
        offset: First byte of the part that may be hit.
        length: Length of that part, bytes; None up to the end.
    """

    name: ClassVar[str] = "corrupt"
    bits: int = 1
    count: int = 0
    offset: int = 0
    length: int | None = None

    def __post_init__(self) -> None:
        if min(self.bits, self.count, self.offset, self.length or 0) < 0:
            raise ConfigError("bits, count, offset and length must be 0 or more")
        if not self.bits and not self.count:
            raise ConfigError("nothing is to be spoiled", hint="give bits = NUMBER or count = NUMBER OF BYTES")

    def message(self, event: Event) -> None:
        """Corrupt its payload."""
        data = bytearray(event.payload)
        end = len(data) if self.length is None else min(len(data), self.offset + self.length)
        if self.offset >= end:
            return
        random = event.random()
        if self.count:
            for place in random.sample(range(self.offset, end), min(self.count, end - self.offset)):
                data[place] ^= random.randrange(1, 256)
        else:
            span = (end - self.offset) * 8
            for bit in random.sample(range(span), min(self.bits, span)):
                data[self.offset + bit // 8] ^= 1 << bit % 8
        event.replace(bytes(data))


@dataclass
class Truncate:
    """Cut the end of payloads off.

    Args:
        length: Number of bytes that are left, or
        fraction: which share of them.
    """

    name: ClassVar[str] = "truncate"
    length: int | None = None
    fraction: float | None = None

    def __post_init__(self) -> None:
        if (self.length is None) == (self.fraction is None):
            raise ConfigError("how much is to be left?", hint="give either length = BYTES or fraction = SHARE")
        if (self.length or 0) < 0 or not 0 <= (self.fraction or 0) <= 1:
            raise ConfigError("length must be 0 or more, fraction between 0 and 1")

    def message(self, event: Event) -> None:
        """Cut it."""
        payload = event.payload
        left = self.length if self.length is not None else int(len(payload) * (self.fraction or 0))
        if left < len(payload):
            event.replace(payload[:left])


@dataclass
class SetField:
    """Set a field.

    Args:
        field: Path of the field, such as `pose.position.x`.
        value: Value that it gets; `nan` and `inf` are numbers where the field is one.
    """

    name: ClassVar[str] = "set"
    field: str
    value: bool | int | float | str

    def message(self, event: Event) -> None:
        """Set it."""
        event.set(self.field, fit_value(self.value, event.read(self.field)))


@dataclass
class ClockOffset:
    """Shift the stamps in messages, as a component with a wrong clock would.

    Without `field`, all stamps of ROS messages are shifted: fields `sec` and `nanosec` of a `stamp`.

    Args:
        seconds: Shift, seconds; negative into the past.
        drift: Further shift for each second that passes, seconds.
        field: Path of one field that holds a time.
        unit: Its unit: s, ms, us or ns.
    """

    name: ClassVar[str] = "clock_offset"
    seconds: float
    drift: float = 0.0
    field: str | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.seconds) and math.isfinite(self.drift)):
            raise ConfigError(f"seconds = {self.seconds} and drift = {self.drift} must be finite")

    def message(self, event: Event) -> None:
        """Shift its stamps."""
        offset = self.seconds + self.drift * event.seconds
        if self.field is None:
            self._shift_stamps(event, round(offset * _UNITS["ns"]))
            return
        value = event.read(self.field)
        if isinstance(value, int) and not isinstance(value, bool):
            event.set(self.field, value + round(offset * _UNITS[self.unit]))
        elif isinstance(value, float):
            event.set(self.field, value + offset * _UNITS[self.unit])
        else:
            raise PayloadError(f"{value!r} is not a time", where=self.field, hint="name a field that holds a number")

    def _shift_stamps(self, event: Event, offset: int) -> None:
        kind, changed = event.type, {}
        for stamp, (seconds, nanoseconds) in _stamps(event).items():
            total = seconds * 10**9 + nanoseconds + offset
            changed[f"{stamp}.sec"], changed[f"{stamp}.nanosec"] = divmod(total, 10**9)
        if kind is not None and len(changed) > _SET_SINGLY:
            event.patched(
                kind.rebuild(event.payload, changed), Change(event.interceptor, "set", "*.stamp", after=offset)
            )
            return
        for path, value in changed.items():
            event.set(path, value)


def _stamps(event: Event) -> dict[str, tuple[int, int]]:
    """Return seconds and nanoseconds of each stamp in a message, by path, those in arrays included."""
    kind, elements = event.type, 16
    while kind is not None:
        values = {leaf.path: leaf.value for leaf in kind.leaves(event.payload, elements=elements)}
        found = {}
        for path, seconds in values.items():
            stamp = path.removesuffix(".sec")
            nanoseconds = values.get(f"{stamp}.nanosec")
            if stamp != path and stamp.endswith("stamp") and isinstance(seconds, int) and isinstance(nanoseconds, int):
                found[stamp] = seconds, nanoseconds
        arrays = {path[: at.start()] for path in found for at in _INDEX.finditer(path)}
        lengths = [length for each in arrays if isinstance(length := values.get(f"len({each})"), int)]
        longest = min(max(lengths, default=0), _MOST_ELEMENTS)
        if longest <= elements:
            return found
        elements = longest
    return {}
