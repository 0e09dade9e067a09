"""What an interceptor sees of one message, and what it can do with it."""

from __future__ import annotations

import hashlib
import random
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

from riot_bus.types.elements import read_elements, read_field
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message, Qos

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.elements import Elements
    from riot_bus.vocabulary.message import Scalar

State = tuple[
    "Message | None", bytes | None, bool, bool, int, int, "tuple[tuple[Message, int], ...]", "tuple[Change, ...]"
]

ValueT = TypeVar("ValueT")

_MOST_ADDED = 10_000  # a guess: more messages or copies are an interceptor's mistake, which would flood the components
_NO_KEY = re.compile("\\A\\Z|\\A/|//|/\\Z|[*$?#\ud800-\udfff]")
_NO_TEXT = re.compile("[\ud800-\udfff]")  # cannot be sent as UTF-8
_CONGESTION = ("drop", "block", "block_first")


@dataclass(frozen=True, slots=True)
class Change:
    """One thing that an interceptor did to a message: ground truth for the log."""

    interceptor: str
    action: str
    field: str | None = None
    before: Scalar | None = None
    after: Scalar | None = None


class Arrival(Protocol):
    """A received message that is decoded only on demand, since most messages pass unchanged.

    Attributes:
        key: Its key.
        time: Time of its arrival, nanoseconds since the Unix epoch.
        segment: Segment that it came from.
    """

    key: str
    time: int
    segment: str

    def payload(self) -> bytes:
        """Return its payload."""
        ...

    def message(self) -> Message:
        """Return the whole message; the same object each time."""
        ...


class Event:
    """One intercepted message on its way.

    Attributes:
        topic: Its topic's name.
        index: Number of earlier messages of this topic.
        seconds: Time since the first message that the pipeline saw.
        segment: Segment that it came from; empty outside of a bus.
        targets: Segments that it goes to; empty outside of a bus.
        dropped: Whether it will not be delivered.
        delay_ns: Delay of its delivery, nanoseconds.
        copies: Number of additional deliveries.
        added: Further messages to deliver, each with its delay in nanoseconds.
        changes: Changes by interceptors so far.
        touched: Whether the message itself was changed.
    """

    # Most messages pass untouched: rarely needed attributes have defaults in the class, and lists are made on demand.
    _message: Message | None
    _payload: bytes | None = None
    _digest = b""
    touched = dropped = False
    delay_ns = copies = 0
    added: Sequence[tuple[Message, int]] = ()
    changes: Sequence[Change] = ()
    branches: Sequence[Event] = ()
    interceptor = ""
    seed = 0

    def __init__(
        self,
        message: Message | None,
        topic: str,
        index: int,
        seconds: float,
        arrival: Arrival | None = None,
        segment: str = "",
        targets: tuple[str, ...] = (),
        kind: MessageType | None = None,
        types: TypeRegistry | None = None,
        *,
        provenance: bool = True,
    ) -> None:
        self._message = self._original = message
        self._arrival = arrival
        self._type = kind
        self._types = types
        self.topic = topic
        self.index = index
        self.seconds = seconds
        self.segment = segment
        self.targets = targets
        self.provenance = provenance

    @property
    def original(self) -> Message:
        """The message as it came."""
        if self._original is None:
            assert self._arrival is not None
            self._original = self._arrival.message()
        return self._original

    @property
    def message(self) -> Message:
        """The message as it is now; may be set."""
        message = self._message
        if message is None:
            message = self.original
            if self._payload is not None:
                message = message.with_payload(self._payload)
            self._message = message
        return message

    @message.setter
    def message(self, message: Message) -> None:
        self._message = _publishable(message, self.key)
        self.touched = True
        self._note(Change(self.interceptor, "replace"))

    @property
    def key(self) -> str:
        """The key as it is now."""
        if self._message is not None:
            return self._message.key
        assert self._arrival is not None
        return self._arrival.key

    @property
    def payload(self) -> bytes:
        """The payload as it is now."""
        if self._message is not None:
            return self._message.payload
        if self._payload is None:
            assert self._arrival is not None
            return self._arrival.payload()
        return self._payload

    @property
    def new_payload(self) -> bytes | None:
        """The payload, if nothing else of the message was changed; None if more may be different."""
        return self._payload if self._message is None else None

    @property
    def digest(self) -> bytes:
        """A hash of the message as it came."""
        self._digest = self._digest or self.original.digest()
        return self._digest

    @property
    def type(self) -> MessageType | None:
        """The message's type, None if unknown."""
        if self._type is None and self._types is not None:
            message = self.message
            self._type = self._types.type_of(message.key, payload=message.payload, encoding=message.encoding)
            self._types = None
        return self._type

    def read(self, path: str) -> Scalar:
        """Return a field's value, or `max(ranges[*])` and the like; raises PayloadError when there is none."""
        return read_field(self._known_type(), self.payload, path)

    def set(self, path: str, value: Scalar) -> None:
        """Set a field, in place if it fits, else by rebuilding the message; `len(path)` sets a length."""
        kind, payload = self._known_type(), self.payload
        if not self.provenance:
            self.patched(kind.rebuild(payload, {path: value}), Change(self.interceptor, "set", path))
            return
        before = kind.read(payload, path)
        payload = kind.rebuild(payload, {path: value})
        # integers wrap and floats narrow: record the resulting value
        self.patched(payload, Change(self.interceptor, "set", path, before, kind.read(payload, path)))

    def read_elements(self, path: str) -> Elements:
        """Return the numbers of an array, or of one field of its records: `path` has one `[*]`, as in `poses[*].x`."""
        return read_elements(self._known_type(), self.payload, path)

    def set_elements(self, path: str, wanted: Elements) -> None:
        """Set the numbers of such an array; raises PayloadError if their count differs."""
        kind, payload, before = self._known_type(), self.payload, self.read_elements(path)
        if len(wanted) != len(before):
            raise PayloadError(f"{len(before)} elements are not set to {len(wanted)}", where=path)
        array, _, rest = path.partition("[*]")
        pairs = enumerate(zip(before, wanted, strict=True))
        changes = {f"{array}[{place}]{rest}": new for place, (old, new) in pairs if repr(old) != repr(new)}
        if changes:
            self.patched(kind.rebuild(payload, changes), Change(self.interceptor, "set", path))

    def replace(self, payload: bytes) -> None:
        """Replace the whole payload."""
        self.patched(_checked(payload, bytes, "a payload"), Change(self.interceptor, "replace"))

    def patched(self, payload: bytes, change: Change) -> None:
        """Take over a patched payload, and record the change."""
        if self._message is None:
            self._payload = payload
        else:
            self._message = self._message.with_payload(payload)
        self.touched = True
        self._note(change)

    def drop(self) -> None:
        """Do not deliver the message."""
        self.dropped = True
        self._note(Change(self.interceptor, "drop"))

    def delay(self, seconds: float) -> None:
        """Deliver the message later; raises ValueError for NaN."""
        self.delay_ns += round(seconds * 1e9)
        self._note(Change(self.interceptor, "delay", after=seconds))

    def duplicate(self, copies: int = 1) -> None:
        """Deliver the message `copies` more times."""
        self.copies += _checked(copies, int, "a number of copies")
        self._note(Change(self.interceptor, "duplicate", after=copies))

    def add(self, message: Message, *, seconds: float = 0.0) -> None:
        """Deliver another message as well, `seconds` from now."""
        entry = _publishable(message, self.key), round(seconds * 1e9)
        if len(self.added) >= _MOST_ADDED:
            raise ValueError(f"more than {_MOST_ADDED} messages added to one are too many")
        if isinstance(self.added, list):
            self.added.append(entry)
        else:
            self.added = [*self.added, entry]
        self._note(Change(self.interceptor, "add"))

    def draw(self, salt: str = "", *, source: str | None = None) -> float:
        """Return a number in [0, 1): the same for the same seed, content and number of the message in its topic.

        Args:
            salt: Text that selects another number for the same message.
            source: Text that replaces all but content and number of the message: interceptor, its seed, salt and topic.
        """
        return int.from_bytes(self._dice(salt, source)[:8], "big") / 2**64

    def random(self, salt: str = "") -> random.Random:
        """Return a generator that is seeded like `draw`."""
        return random.Random(self._dice(salt))  # noqa: S311

    def branch(self, target: str) -> Event:
        """Split off the delivery to one segment, so that it can be changed separately."""
        branch = Event(
            self._original,
            self.topic,
            self.index,
            self.seconds,
            self._arrival,
            self.segment,
            (target,),
            self._type,
            self._types,
            provenance=self.provenance,
        )
        branch._message, branch._payload, branch._digest = self._message, self._payload, self._digest
        branch.touched, branch.delay_ns, branch.copies = self.touched, self.delay_ns, self.copies
        branch.changes = list(self.changes)
        self.branches = [*self.branches, branch]
        self.targets = tuple(name for name in self.targets if name != target)
        return branch

    def snapshot(self) -> State | None:
        """Return the state that `restore` brings back; None as long as nothing has happened."""
        if not self.changes:
            return None
        return (
            self._message,
            self._payload,
            self.touched,
            self.dropped,
            self.delay_ns,
            self.copies,
            tuple(self.added),
            tuple(self.changes),
        )

    def restore(self, state: State | None) -> None:
        """Undo what happened since `snapshot`."""
        self._message, self._payload, self.touched, self.dropped, self.delay_ns, self.copies, self.added, changes = (
            state or (self._original, None, False, False, 0, 0, (), ())
        )
        self.changes = list(changes)

    def _note(self, change: Change) -> None:
        if isinstance(self.changes, list):
            self.changes.append(change)
        else:
            self.changes = [change]

    def _dice(self, salt: str, source: str | None = None) -> bytes:
        if source is None:
            source = f"{self.seed}:{self.interceptor}:{salt}:{self.topic}"
        return hashlib.sha256(f"{source}:{self.index}:".encode() + self.digest).digest()

    def _known_type(self) -> MessageType:
        kind = self._type or self.type
        if kind is None:
            raise PayloadError(
                "the type of this message is unknown, so its fields are too",
                where=self.topic,
                hint="name the type in riot.toml under [system.types]",
            )
        return kind


def check(event: Event) -> None:
    """Raise an error if an interceptor set an attribute of an event to an invalid value."""
    if event.delay_ns.__class__ is not int or event.copies.__class__ is not int:
        raise TypeError(f"delay_ns = {event.delay_ns!r} and copies = {event.copies!r} have to be whole numbers")
    if event.copies > _MOST_ADDED:
        raise ValueError(f"{event.copies} copies of one message are too many")
    for each in (event.added, event.changes):
        if each.__class__ is not list and each.__class__ is not tuple:
            raise TypeError(f"{each!r} is not a list of messages or changes")
    for message, delay_ns in event.added:
        _publishable(message, event.key)
        _checked(delay_ns, int, "a delay in nanoseconds")


def _checked(value: ValueT, kind: type, what: str) -> ValueT:
    if not isinstance(value, kind):
        raise TypeError(f"{value!r} is not {what}")
    return value


def _publishable(message: Message, key: str) -> Message:
    """Return the message if it can be published; raise at once if not, so that the code at fault is named."""
    if not isinstance(message, Message):
        raise TypeError(f"{message!r} is not a message")
    if message.key != key and (not isinstance(message.key, str) or _NO_KEY.search(message.key)):
        raise ValueError(f"{message.key!r} is not a key to publish on")
    if message.payload.__class__ is not bytes or not isinstance(message.attachment, bytes | None):
        raise TypeError("payload and attachment of a message have to be bytes")
    if not isinstance(message.encoding, str) or _NO_TEXT.search(message.encoding) or message.time.__class__ is not int:
        raise TypeError(f"encoding = {message.encoding!r} has to be text, and time = {message.time!r} a whole number")
    qos = message.qos
    if not isinstance(qos, Qos) or qos.priority not in range(1, 8) or qos.congestion not in _CONGESTION:
        raise ValueError(f"{qos!r} is not a valid Qos")
    if message.kind not in ("put", "delete"):
        raise ValueError(f"{message.kind!r} is neither put nor delete")
    return message


class Interceptor(Protocol):
    """Code that sees each intercepted message; any class with this one method will do."""

    def message(self, event: Event) -> None:
        """Look at the event, and change it if wanted."""
        ...
