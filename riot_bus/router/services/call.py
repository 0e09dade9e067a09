"""A call of a service: the question of one component, and what has become of it so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.types.serve import ERROR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

__all__ = ["Call", "encoding_text", "payload_of", "reply_to"]

_DEFAULT_ENCODING = "zenoh/bytes"


@dataclass(slots=True, eq=False)
class Call:
    """One query that was taken in; only its lane's thread changes it.

    Attributes:
        query: A `zenoh.Query` as it came; when it is dropped, its caller hears that there are no more replies.
        tokens: Each a `zenoh.CancellationToken` that ends a question that was asked for it.
        number: Given to the request and all its replies as `Message.sequence`.
        targets: Segments whose services are asked, and whether only complete ones are.
        wide: Whether the query means more than the expression that it was taken for; then others answer the rest.
        questions: Those that are not answered to the end.
        pending: How many they are, with messages that are on their way.
        silent: Whether something was dropped; then the caller hears nothing, as if it were lost.
        over: Whether it has ended.
        size: Bytes of its payload.
    """

    query: Any  # Zenoh's stubs leave much of it untyped
    number: int
    targets: Mapping[str, bool]
    wide: bool = False
    pending: int = 0
    silent: bool = False
    over: bool = False
    size: int = 0
    questions: set[object] = field(default_factory=set)
    tokens: list[Any] = field(default_factory=list)

    def payload(self, message: Message) -> bytes | None:
        """Return the payload to ask with; a query without one stays without."""
        return None if not message.payload and self.query.payload is None else message.payload


def payload_of(thing: Any) -> bytes:
    """Return the payload of a query or sample, which may have none."""
    payload = thing.payload
    return b"" if payload is None else bytes(payload.to_bytes())


def reply_to(query: Any, key: str, part: str, message: Message, *, stamp: zenoh.Timestamp | None = None) -> None:
    """Answer a query with a message.

    Args:
        query: A `zenoh.Query`.
        key: Key of the reply.
        part: Which part of a call the message is: a reply, or one that tells of an error.
        message: Payload, encoding and attachment; a delete is one.
        stamp: The service's own timestamp, by which replies are consolidated, if it has given one.
    """
    encoding = message.encoding or _DEFAULT_ENCODING
    if part == ERROR:
        query.reply_err(message.payload, encoding=encoding)
    elif message.kind == "delete":
        query.reply_del(key, attachment=message.attachment, timestamp=stamp)
    else:
        query.reply(key, message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp)


def encoding_text(encoding: zenoh.Encoding | None) -> str:
    """Return an encoding as messages have it: empty for the default."""
    text = "" if encoding is None else str(encoding)
    return "" if text == _DEFAULT_ENCODING else text
