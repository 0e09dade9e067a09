"""Faults in payloads: frozen, corrupt, cut, set, and with wrong stamps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

from riot_bus.errors import ConfigError
from riot_bus.inject.interceptor import fit_value
from riot_bus.interceptors.per_topic import PerTopic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.pipeline.event import Event

__all__ = ["ClockOffset", "Corrupt", "Freeze", "SetField", "Truncate"]

_UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_NANOSECONDS = 10**9


@dataclass
class Freeze:
    """Repeat the last value: selected messages carry the payload of the first one that was selected.

    A message that is not selected ends it; the next one that is selected is repeated anew.

    Args:
        hold: For how many messages a value is repeated; 0 for as long as messages are selected.
    """

    name: ClassVar[str] = "freeze"
    hold: int = 0
    _frozen: PerTopic[tuple[bytes, int, int]] = field(default_factory=PerTopic, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.hold < 0:
            raise ConfigError(f"hold = {self.hold} is below 0")

    def message(self, event: Event) -> None:
        """Replace its payload."""
        payload, first, last = self._frozen.get(event.topic, (b"", 0, -2))
        index = event.index
        if index != last + 1 or (self.hold and index - first > self.hold):
            self._frozen[event.topic] = (event.payload, index, index)
            return
        self._frozen[event.topic] = (payload, first, index)
        if event.payload != payload:
            event.replace(payload)


@dataclass
class Corrupt:
    """Flip bits or replace bytes.

    Args:
        bits: How many bits are flipped.
        count: How many bytes are replaced, instead.
        offset: Where the part begins that may be hit.
        length: How long it is; None up to the end.
    """

    name: ClassVar[str] = "corrupt"
    bits: int = 1
    count: int = 0
    offset: int = 0
    length: int | None = None

    def __post_init__(self) -> None:
        if min(self.bits, self.count, self.offset, self.length or 0) < 0:
            raise ConfigError("bits, count, offset and length must be 0 or more")

    def message(self, event: Event) -> None:
        """Spoil its payload."""
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
        length: How many bytes are left, or
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
        value: What it is set to; `nan` and `inf` are numbers where the field is one.
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
        seconds: How far, negative into the past.
        drift: How many seconds more for each second that passes.
        field: Path of one field that holds a time.
        unit: Its unit: s, ms, us or ns.
    """

    name: ClassVar[str] = "clock_offset"
    seconds: float
    drift: float = 0.0
    field: str | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"

    def message(self, event: Event) -> None:
        """Shift its stamps."""
        offset = self.seconds + self.drift * event.seconds
        if self.field is not None:
            value = event.read(self.field)
            if isinstance(value, int) and not isinstance(value, bool):
                event.set(self.field, value + round(offset * _UNITS[self.unit]))
            elif isinstance(value, float):
                event.set(self.field, value + offset * _UNITS[self.unit])
            return
        for stamp in list(_stamps(event)):
            seconds, nanoseconds = event.read(f"{stamp}.sec"), event.read(f"{stamp}.nanosec")
            if isinstance(seconds, int) and isinstance(nanoseconds, int):
                total = seconds * _NANOSECONDS + nanoseconds + round(offset * _NANOSECONDS)
                event.set(f"{stamp}.sec", total // _NANOSECONDS)
                event.set(f"{stamp}.nanosec", total % _NANOSECONDS)


def _stamps(event: Event) -> Iterator[str]:
    if event.type is not None:
        for leaf in event.type.leaves(event.payload):
            if leaf.path.endswith(("stamp.sec", "stamp.sec]")) and leaf.path.rpartition(".")[2] == "sec":
                yield leaf.path.removesuffix(".sec")
