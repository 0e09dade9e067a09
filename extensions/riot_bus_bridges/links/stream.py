"""Byte streams as ends of links; written data waits, up to a limit, while there is no room."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

from riot_bus.vocabulary.errors import needs_extra
from riot_bus_bridges.links.end import End
from riot_bus_bridges.links.link import Host, Link, RetriedLink
from riot_bus_bridges.links.loop import READ, WRITE
from riot_bus_bridges.mavlink.url import LinkSpec

_MOST_UNSENT = 1 << 18  # takes 23 s at 115200 baud: what would wait longer is better lost, and counted


Transport: TypeAlias = "socket.socket | _Device"
"""An open socket or device that never waits."""


class Stream:
    """One open stream, an end of a link."""

    def __init__(
        self, link: Link, host: Host, *, address: str, transport: Transport, gone: Callable[[Stream], None]
    ) -> None:
        self._link, self._host, self._transport, self._gone = link, host, transport, gone
        self._lock = threading.Lock()
        self._unsent = bytearray()
        self._open = True
        self._number = transport.fileno()
        with self._lock:  # nothing is written before it is watched
            self.end: End = link.join(address, self._write, self._write_all)
            host.loop.watch(self._number, self._handle)

    def close(self) -> None:
        """Close the stream."""
        self.end.flush()
        with self._lock:
            if not self._open:
                return
            self._open = False
            self._host.loop.forget(self._number)
            self._transport.close()
        self._link.leave(self.end)

    def _write(self, data: bytes) -> bool:
        """Take a whole frame or nothing; return whether it was taken."""
        with self._lock:
            if not self._open:
                return False
            if self._unsent:
                if len(self._unsent) + len(data) > _MOST_UNSENT:
                    return False
                self._unsent += data
                return True
            try:
                done = self._transport.send(data)
            except BlockingIOError:
                done = 0
            except OSError:  # the next read detects that the stream has ended
                return False
            if done < len(data):
                self._unsent += data[done:]
                self._host.loop.change(self._number, READ | WRITE)
            return True

    def _write_all(self, frames: Sequence[bytes]) -> int:
        """Take whole frames; return how many."""
        if len(self._unsent) + sum(map(len, frames)) <= _MOST_UNSENT:
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
                done = self._transport.send(bytes(self._unsent))
            except BlockingIOError:
                return
            except OSError:
                done = len(self._unsent)
            del self._unsent[:done]
            if not self._unsent:
                self._host.loop.change(self._number, READ)

    def _read(self) -> None:
        try:
            data = self._transport.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._host.receive(self.end, [data])
        else:
            self.close()
            self._gone(self)


class StreamClient(RetriedLink):
    """Link of one stream, for which the `_try` of a subclass calls `_opened` or `_again`."""

    lost: ClassVar[str]

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host)
        self._stream: Stream | None = None

    def close(self) -> None:
        """Close the link and its stream."""
        if self._stream is not None:
            self._stream.close()
        super().close()

    def _opened(self, transport: Transport) -> None:
        self._last_reason = ""
        self._stream = Stream(self, self._host, address=self.where, transport=transport, gone=self._lost)

    def _lost(self, stream: Stream) -> None:
        self._stream = None
        self._again(self.lost)


class _Device:
    """Device opened by pyserial, which sets the rate; its descriptor is read and written without waiting."""

    def __init__(self, opened: Any) -> None:
        self._opened = opened
        self._number: int = opened.fileno()
        os.set_blocking(self._number, False)

    def fileno(self) -> int:
        return self._number

    def recv(self, most: int) -> bytes:
        return os.read(self._number, most)

    def send(self, data: bytes) -> int:
        return os.write(self._number, data)

    def close(self) -> None:
        self._opened.close()


class SerialLink(StreamClient):
    """Opens a device, and reopens it after it was unplugged."""

    lost, retry = "unplugged", 1.0

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        with needs_extra("pyserial", "mavlink"):
            import serial
        super().__init__(spec, host)
        self._serial: Any = serial
        self._try()

    def _try(self) -> None:
        try:
            device = _Device(self._serial.Serial(self.spec.path, self.spec.baud, timeout=0, write_timeout=0))
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            self._again(getattr(error, "strerror", None) or str(error))
        else:
            self._opened(device)
