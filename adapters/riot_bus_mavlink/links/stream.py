"""Links that are byte streams; written data waits, up to a limit, while there is no room."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Protocol

from riot_bus_mavlink.links.end import Batching
from riot_bus_mavlink.links.loop import READ, WRITE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.links.end import End, Host
    from riot_bus_mavlink.links.loop import Timer

__all__ = ["RetriedLink", "Stream", "Transport"]

_MOST_WAITING = 1 << 18  # takes 23 s at 115200 baud: what would wait longer is better lost, and counted
_MOST_READ = 1 << 16  # other links wait while the frames of one read are handled; not measured


class Transport(Protocol):
    """An open socket or device that never waits."""

    def fileno(self) -> int:
        """Return its descriptor."""

    def receive(self, most: int) -> bytes:
        """Return available bytes, none at the end. Raises BlockingIOError if nothing is there, OSError if it broke."""

    def send(self, data: bytes) -> int:
        """Return how many bytes were taken. Raises BlockingIOError if none, OSError if it broke."""

    def close(self) -> None:
        """Close it."""


class Stream:
    """One open stream, an end of a link.

    Args:
        spec: Settings of the link.
        address: Address of the other end.
        transport: Open transport, closed with the stream.
        host: Gets what comes.
        gone: Called on the loop's thread when the other end has closed the stream, or it broke.
    """

    def __init__(
        self, spec: LinkSpec, address: str, *, transport: Transport, host: Host, gone: Callable[[Stream], None]
    ) -> None:
        self._transport, self._host, self._gone = transport, host, gone
        self._lock = threading.Lock()
        self._waiting = bytearray()
        self._open = True
        self._number = transport.fileno()
        with self._lock:  # nothing is written before it is watched
            self.end: End = host.join(spec, address, self._write, Batching(host.loop, self._write_all))
            host.loop.watch(self._number, self._handle)

    def close(self) -> None:
        """Close it."""
        self.end.flush()
        with self._lock:
            if not self._open:
                return
            self._open = False
            self._host.loop.forget(self._number)
            self._transport.close()
        self._host.leave(self.end)

    def _write(self, data: bytes) -> bool:
        """Take a whole frame or nothing; return whether it was taken."""
        with self._lock:
            if not self._open:
                return False
            if self._waiting:
                if len(self._waiting) + len(data) > _MOST_WAITING:
                    return False
                self._waiting += data
                return True
            try:
                done = self._transport.send(data)
            except BlockingIOError:
                done = 0
            except OSError:  # the next read detects that the stream has ended
                return False
            if done < len(data):
                self._waiting += data[done:]
                self._host.loop.change(self._number, READ | WRITE)
            return True

    def _write_all(self, frames: Sequence[bytes]) -> int:
        """Take whole frames; return how many."""
        if len(self._waiting) + sum(map(len, frames)) <= _MOST_WAITING:
            return len(frames) if self._write(b"".join(frames)) else 0
        return sum(map(self._write, frames))

    def _handle(self, events: int) -> None:
        if events & WRITE:
            self._flush()
        if events & READ:
            self._read()

    def _flush(self) -> None:
        with self._lock:
            if not self._open:
                return
            try:
                done = self._transport.send(bytes(self._waiting))
            except BlockingIOError:
                return
            except OSError:
                done = len(self._waiting)
            del self._waiting[:done]
            if not self._waiting:
                self._host.loop.change(self._number, READ)

    def _read(self) -> None:
        try:
            data = self._transport.receive(_MOST_READ)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._host.take(self.end, [data])
        else:
            self.close()
            self._gone(self)


class RetriedLink(ABC):
    """Link of one stream that is reopened, after a while, whenever it is lost or cannot be opened.

    The `_try` of a subclass opens it and calls `_opened` or `_again`, now or later, on the loop's thread.

    Args:
        spec: Settings of the link.
        host: Gets what comes.

    Attributes:
        lost: Text that is reported when the other end has gone.
        retry: Seconds until the next attempt.
    """

    lost: ClassVar[str]
    retry: ClassVar[float]

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        self.spec = spec
        self._host = host
        self._stream: Stream | None = None
        self._timer: Timer | None = None
        self._told = ""
        self._closed = False

    @property
    def where(self) -> str:
        """Return the other end, as the user wrote it."""
        return self.spec.where

    @property
    def state(self) -> str:
        """Return how it is."""
        return "connecting" if self._stream is None else "connected"

    def dropped(self) -> int:
        """Return 0: TCP drops nothing, and losses of a device cannot be detected."""
        return 0

    def close(self) -> None:
        """Close it."""
        self._closed = True
        self._wait_no_more()
        if self._stream is not None:
            self._stream.close()

    @abstractmethod
    def _try(self) -> None:
        """Open it."""

    def _opened(self, transport: Transport) -> None:
        self._told = ""
        self._stream = Stream(
            self.spec, self.spec.where, transport=transport, host=self._host, gone=lambda _: self._lost()
        )

    def _lost(self) -> None:
        self._stream = None
        self._again(self.lost)

    def _again(self, why: str) -> None:
        """Try again later; report the same reason only once."""
        self._wait_no_more()
        if self._closed:
            return
        if why != self._told:
            self._told = why
            self._host.warn(self.spec, f"{why}; it is tried again")
        self._timer = self._host.loop.later(self.retry, self._try)

    def _wait_no_more(self) -> None:
        """Cancel the pending attempt."""
        if self._timer is not None:
            self._timer.cancel()
