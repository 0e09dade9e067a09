"""A call of a service: the question of one component, and what has become of it so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

__all__ = ["Call", "encoding_text", "payload_of"]

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


def encoding_text(encoding: zenoh.Encoding | None) -> str:
    """Return an encoding as messages have it: empty for the default."""
    text = "" if encoding is None else str(encoding)
    return "" if text == _DEFAULT_ENCODING else text
