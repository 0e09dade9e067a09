"""A call of a service: the query of one component, and its state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.types.serve import ERROR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

_DEFAULT_ENCODING = "zenoh/bytes"


@dataclass(slots=True, eq=False)
class Call:
    """One query that was taken in; only its forwarder's thread changes it.

    Attributes:
        query: The received `zenoh.Query`; dropping it tells the caller that there are no more replies.
        tokens: Tokens (`zenoh.CancellationToken`) that cancel the queries sent to services for this call.
        number: Sequence number of the request and all its replies (`Message.sequence`).
        targets: Segments whose services are asked, and whether only complete services are asked there.
        wide: Whether the query matches more than the intercepted expression; then others answer the rest.
        questions: Queries sent to services that have not ended yet.
        pending: Number of these queries and of messages in transit.
        silent: Whether a message was dropped; then the caller is not told of the end, as if the message were lost.
        size: Size of the payload in bytes.
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
        """Return the payload of the query to send; None if both the received query and the message have none."""
        return None if not message.payload and self.query.payload is None else message.payload


def payload_of(thing: Any) -> bytes:
    """Return the payload of a query or sample, which may have none."""
    payload = thing.payload
    return b"" if payload is None else bytes(payload.to_bytes())


def reply_to(query: Any, key: str, part: str, message: Message, *, stamp: zenoh.Timestamp | None = None) -> None:
    """Answer a query with a message."""
    encoding = message.encoding or _DEFAULT_ENCODING
    if part == ERROR:
        query.reply_err(message.payload, encoding=encoding)
    elif message.kind == "delete":
        query.reply_del(key, attachment=message.attachment, timestamp=stamp)
    else:
        query.reply(key, message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp)


def encoding_text(encoding: zenoh.Encoding | None) -> str:
    """Return an encoding as text, as in messages; empty for the default."""
    text = "" if encoding is None else str(encoding)
    return "" if text == _DEFAULT_ENCODING else text
