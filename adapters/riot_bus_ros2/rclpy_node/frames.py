"""What the two ends of a bridge send each other over a socket: messages as bytes, all else as JSON."""

from __future__ import annotations

import contextlib
import json
import struct
import threading
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import socket

__all__ = ["Frame", "Kind", "Wire"]

_HEADER = struct.Struct("<IBIq")
_JOINED = 1 << 16
_BUFFER = 1 << 20


class Kind(IntEnum):
    """What a frame is.

    An order is for the node, an event comes from it. A failure is a response that will not come.
    """

    DOCUMENT = 0
    MESSAGE = 1
    REQUEST = 2
    RESPONSE = 3
    FAILURE = 4


class Frame(NamedTuple):
    """One frame.

    Attributes:
        kind: What it is.
        endpoint: Number of the publisher, subscription, server or client.
        number: Of a message: when it was published, nanoseconds since the Unix epoch, 0 if unknown. Else what joins a
            response to its request.
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
    """One end; any thread may send, one receives.

    Args:
        connection: Connected stream socket, from now on owned by this object.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._input = connection.makefile("rb", buffering=_BUFFER)
        self._lock = threading.Lock()

    def send(self, kind: Kind, endpoint: int, number: int, payload: bytes) -> None:
        """Send a frame; raises OSError if the other end is gone."""
        header = _HEADER.pack(len(payload), kind, endpoint, number)
        with self._lock:
            if len(payload) < _JOINED:
                self._socket.sendall(header + payload)
            else:
                self._socket.sendall(header)
                self._socket.sendall(payload)

    def tell(self, document: dict[str, Any]) -> None:
        """Send an order or an event."""
        self.send(Kind.DOCUMENT, 0, 0, json.dumps(document).encode())

    def receive(self) -> Frame | None:
        """Wait for the next frame; None if the other end is gone."""
        try:
            header = self._input.read(_HEADER.size)
            if len(header) < _HEADER.size:
                return None
            size, kind, endpoint, number = _HEADER.unpack(header)
            payload = self._input.read(size)
        except OSError:
            return None
        return Frame(kind, endpoint, number, payload) if len(payload) == size else None

    def hang_up(self) -> None:
        """Let both ends' `receive` return None; safe to call twice, and from other threads."""
        import socket

        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Give the socket back."""
        self.hang_up()
        self._input.close()
        self._socket.close()
