"""What an interceptor sees of one message, and what it can do with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from riot_bus.errors import PayloadError

if TYPE_CHECKING:
    from riot_bus.message import Message
    from riot_bus.trial import Scalar
    from riot_bus.types.model import MessageType

__all__ = ["Change", "Event", "Interceptor"]


@dataclass(frozen=True, slots=True)
class Change:
    """One thing that an interceptor did to a message: ground truth for the log."""

    interceptor: str
    action: str
    field: str | None = None
    before: Scalar | None = None
    after: Scalar | None = None


@dataclass(slots=True)
class Event:
    """One intercepted message on its way.

    Attributes:
        message: The message as it is now.
        topic: Its topic's name.
        index: Number of earlier messages of this topic.
        seconds: Time since the first message that the pipeline saw.
        type: Its type, None if unknown.
    """

    message: Message
    topic: str
    index: int
    seconds: float
    type: MessageType | None = None
    dropped: bool = False
    delay_ns: int = 0
    copies: int = 0
    added: list[tuple[Message, int]] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    interceptor: str = ""

    def _type(self) -> MessageType:
        if self.type is None:
            raise PayloadError(
                "the type of this message is unknown, so its fields are too",
                where=self.topic,
                hint="name the type in riot.toml under [system.types]",
            )
        return self.type

    def read(self, path: str) -> Scalar:
        """Return a field's value; raises PayloadError when there is none."""
        return self._type().read(self.message.payload, path)

    def set(self, path: str, value: Scalar) -> None:
        """Set a field in place."""
        kind = self._type()
        before = kind.read(self.message.payload, path)
        payload = kind.patch(self.message.payload, {path: value})
        after = kind.read(payload, path)  # integers wrap, floats narrow: note what is there now
        self.message = self.message.with_(payload=payload)
        self.changes.append(Change(self.interceptor, "set", path, before, after))

    def replace(self, payload: bytes) -> None:
        """Replace the whole payload."""
        self.message = self.message.with_(payload=payload)
        self.changes.append(Change(self.interceptor, "replace"))

    def drop(self) -> None:
        """Do not deliver the message."""
        self.dropped = True
        self.changes.append(Change(self.interceptor, "drop"))

    def delay(self, seconds: float) -> None:
        """Deliver the message later."""
        self.delay_ns += int(seconds * 1e9)
        self.changes.append(Change(self.interceptor, "delay", after=seconds))

    def duplicate(self, copies: int = 1) -> None:
        """Deliver the message `copies` more times."""
        self.copies += copies
        self.changes.append(Change(self.interceptor, "duplicate", after=copies))

    def add(self, message: Message, *, seconds: float = 0.0) -> None:
        """Deliver another message as well, `seconds` from now."""
        self.added.append((message, int(seconds * 1e9)))
        self.changes.append(Change(self.interceptor, "add"))


class Interceptor(Protocol):
    """Code that sees each intercepted message; any class with this one method will do."""

    def message(self, event: Event) -> None:
        """Look at the event, and change it if wanted."""
        ...
