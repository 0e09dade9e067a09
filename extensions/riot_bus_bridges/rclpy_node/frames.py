"""Frames between the two ends of a bridge over a socket: messages as bytes, everything else as JSON."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from .outbox import Outbox

if TYPE_CHECKING:
    from collections.abc import Iterable

NODE_PREFIX = "riot_bridge_"
"""Prefix of the names of bridge nodes in their domains."""

_HEADER = struct.Struct("<IBIq")
_JOINED = 1 << 16  # a guess: copying more than this costs more than queueing a second piece
_BUFFER = 1 << 20  # one read takes many small frames; more would only take memory


class BridgeFrameKind(IntEnum):
    """Kind of a frame.

    A document is an order for the node, or an event that it reports. A failure says that a response will not come or,
    from the sender of the request, that it is no longer awaited.
    """

    DOCUMENT = 0
    MESSAGE = 1
    REQUEST = 2
    RESPONSE = 3
    FAILURE = 4


class BridgeFrame(NamedTuple):
    """One frame.

    Attributes:
        kind: Kind of the frame.
        endpoint: Number of the publisher, subscription, server or client.
        number: For a message, its time of publication in nanoseconds since the Unix epoch, 0 if unknown; otherwise the
            number that a request and its response share.
        payload: CDR with its encapsulation, or JSON.
    """

    kind: int
    endpoint: int
    number: int
    payload: bytes

    def document(self) -> dict[str, Any]:
        """Return the JSON of a document."""
        found: dict[str, Any] = json.loads(self.payload)
        return found


class Wire:
    """One end of the socket; any thread may send, only one may receive.

    Args:
        connection: Connected stream socket, from now on owned by this object.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._input = connection.makefile("rb", buffering=_BUFFER)
        self._outbox = Outbox(connection)

    def send(self, kind: BridgeFrameKind, endpoint: int, number: int, payload: bytes, *, patient: bool = True) -> None:
        """Send a frame; raises OSError if the other end is gone.

        The receiving thread must not be patient, which is to wait while the queue is full, lest both ends wait.
        """
        header = _HEADER.pack(len(payload), kind, endpoint, number)
        if len(payload) < _JOINED:
            self._outbox.put(header + payload, patient=patient)
        else:
            self._outbox.put(header, payload, patient=patient)

    def send_messages(self, endpoint: int, messages: Iterable[tuple[int, bytes]]) -> None:
        """Send frames of messages, given as number and payload; raises OSError if the other end is gone."""
        pieces: list[bytes] = []
        for number, payload in messages:
            pieces += (_HEADER.pack(len(payload), BridgeFrameKind.MESSAGE, endpoint, number), payload)
        self._outbox.put(b"".join(pieces))

    def tell(self, document: dict[str, Any]) -> None:
        """Send an order or an event."""
        self.send(BridgeFrameKind.DOCUMENT, 0, 0, json.dumps(document).encode(), patient=False)

    def flush(self, timeout: float) -> bool:
        """Wait until everything sent is in the socket; return whether it is."""
        return self._outbox.flush(timeout)

    def receive(self) -> BridgeFrame | None:
        """Wait for the next frame; return None if the other end is gone."""
        try:
            header = self._input.read(_HEADER.size)
            if len(header) < _HEADER.size:
                return None
            size, kind, endpoint, number = _HEADER.unpack(header)
            payload = self._input.read(size)
        except OSError:
            return None
        return BridgeFrame(kind, endpoint, number, payload) if len(payload) == size else None

    def hang_up(self) -> None:
        """Make `receive` return None at both ends; safe to call twice, and from other threads."""
        self._outbox.end()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the socket."""
        self.hang_up()
        self._outbox.close()
        self._input.close()
        self._socket.close()
