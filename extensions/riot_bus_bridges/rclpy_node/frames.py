"""Frames between the two ends of a bridge over a socket: messages as bytes, everything else as JSON."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

NODE_PREFIX = "riot_bridge_"
"""Prefix of the names of bridge nodes in their domains."""

_HEADER = struct.Struct("<IBIq")
_JOINED = 1 << 16  # a guess: copying more than this costs more than queueing a second piece


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
        number: For a message, its time of publication in nanoseconds since the Unix epoch, 0 if unknown; otherwise the
            number that a request and its response share.
    """

    kind: int
    endpoint: int
    number: int
    payload: bytes

    def document(self) -> dict[str, Any]:
        """Return the JSON of a document."""
        found: dict[str, Any] = json.loads(self.payload)
        return found


_ROOM = 1 << 24  # when the reader is slow, relaying threads wait instead of memory growing
_AT_ONCE = 1 << 20  # a guess: saves system calls for small pieces, and copies for large ones


class Outbox:
    """Takes bytes from any thread.

    If the queue is empty, bytes are written at once, as far as the socket takes them without waiting. The rest is
    written by a thread, as much at once as there is. The queue is bounded: callers wait while it is full.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._queue: list[bytes | memoryview] = []
        self._size = 0  # bytes in the queue or being written by the thread
        self._ended = False
        self._thread: threading.Thread | None = None

    def put(self, *pieces: bytes, patient: bool = True) -> None:
        """Write bytes or queue them; raises OSError if the other end is gone."""
        size = sum(map(len, pieces))
        with self._lock:
            if self._size and patient:
                self._changed.wait_for(lambda: self._ended or self._size + size <= _ROOM or not self._size)
            if self._ended:
                raise BrokenPipeError("the other end is gone")
            sent = 0
            if not self._size:
                with contextlib.suppress(BlockingIOError):
                    sent = self._socket.sendmsg(pieces, (), socket.MSG_DONTWAIT)
                if sent == size:
                    return
            self._queue += _after(pieces, sent)
            self._size += size - sent
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="riot-outbox", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def flush(self, timeout: float) -> bool:
        """Wait until all is written; return whether it is."""
        with self._lock:
            self._changed.wait_for(lambda: self._ended or not self._size, timeout)
            return not self._size

    def end(self) -> None:
        """Stop taking and writing bytes, and drop the queue; safe to call twice, and from any thread."""
        with self._lock:
            self._ended = True
            self._queue.clear()
            self._changed.notify_all()

    def close(self) -> None:
        """End, and wait for the thread; call it when the socket is shut down."""
        self.end()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._lock:
                self._changed.wait_for(lambda: self._ended or self._queue)
                if self._ended:
                    return
                pieces, self._queue = self._queue, []
            try:
                for data in _joined(pieces):
                    self._socket.sendall(data)
                    with self._lock:
                        self._size -= len(data)
                        self._changed.notify_all()
            except OSError:
                self.end()


def _after(pieces: Sequence[bytes], sent: int) -> Iterator[bytes | memoryview]:
    """Yield what is left of pieces after the first `sent` bytes."""
    for piece in pieces:
        if sent < len(piece):
            yield memoryview(piece)[sent:] if sent else piece
        sent = max(0, sent - len(piece))


def _joined(pieces: list[bytes | memoryview]) -> list[bytes | memoryview]:
    """Return fewer and larger pieces, without copying large ones."""
    found: list[bytes | memoryview] = []
    small: list[bytes | memoryview] = []
    size = 0
    for piece in pieces:
        if size + len(piece) > _AT_ONCE:
            found += [b"".join(small)] if small else []
            small, size = [], 0
        small.append(piece)
        size += len(piece)
    return [*found, small[0] if len(small) == 1 else b"".join(small)]


class Wire:
    """One end of the socket; any thread may send, only one may receive."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._input = connection.makefile("rb", buffering=1 << 20)
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
