"""Queue that writes bytes of many threads to a socket in order; the threads wait only if it is full."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_ROOM = 1 << 24  # when the reader is slow, relaying threads wait instead of memory growing
_AT_ONCE = 1 << 20  # a guess: saves system calls for small pieces, and copies for large ones


class Outbox:
    """Takes bytes from any thread.

    If the queue is empty, bytes are written at once, as far as the socket takes them without waiting. The rest is
    written by a thread, as much at once as there is. The queue is bounded: callers wait while it is full.

    Args:
        connection: Connected stream socket, owned by the caller.
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
        """Write bytes or queue them; raises OSError if the other end is gone.

        Args:
            pieces: Pieces of bytes that stay together.
            patient: Whether to wait until there is room; if not, they are queued nevertheless.
        """
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
