"""One MAVLink connection of a process, in pymavlink's spelling of addresses."""

from __future__ import annotations

import select
import socket
import sys
from contextlib import suppress
from time import monotonic, sleep

from pymavlink.dialects.v20 import ardupilotmega as mavlink

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Self

    from pymavlink.dialects.v20.ardupilotmega import MAVLink_message as Message

MOST = 65536
RETRY = 0.05
PATIENCE = 30.0
KINDS = ("udpin", "udpout", "tcpin", "tcp")


class Link:
    """Sends and receives messages, and counts what was lost on the way.

    Args:
        url: `udpin:HOST:PORT` (answers whoever has sent last), `udpout:HOST:PORT`, `tcp:HOST:PORT` (connects, again if
            need be) or `tcpin:HOST:PORT` (takes one peer at a time).
        system: Our MAVLink system.
        component: Our component of it.

    Attributes:
        lost: Gaps in the sequence numbers of each sender, by system and component.
        received: How many messages came from each.
    """

    def __init__(self, url: str, *, system: int, component: int) -> None:
        self._kind, self._address = _parsed(url)
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self.codec = mavlink.MAVLink(self, srcSystem=system, srcComponent=component)
        self.codec.robust_parsing = True
        self.lost: dict[tuple[int, int], int] = {}
        self.received: dict[tuple[int, int], int] = {}
        self._next: dict[tuple[int, int], int] = {}
        self._open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for each in (self._socket, self._listener):
            if each is not None:
                each.close()

    def send(self, message: Message) -> None:
        """Send one message; while nobody is there, it is lost, as on any radio."""
        self.codec.send(message)

    def write(self, data: bytes) -> None:
        """Send bytes (what pymavlink calls)."""
        with suppress(OSError):
            if self._kind == "udpin":
                if self._socket is not None and self._peer is not None:
                    self._socket.sendto(data, self._peer)
            elif self._socket is not None:
                self._socket.sendall(data)

    def receive(self, until: float) -> list[Message]:
        """Wait for messages until a time of the monotonic clock; return what has come, if anything."""
        source = self._socket or self._listener
        wait = max(0.0, until - monotonic())
        if source is None:
            sleep(min(wait, RETRY))
            self._connect()
            return []
        if not select.select([source], [], [], wait)[0]:
            return []
        if self._socket is None:
            assert self._listener is not None
            self._socket = self._listener.accept()[0]
            return []
        data = self._take()
        return [message for message in self.codec.parse_buffer(data) or [] if self._counted(message)]

    def _take(self) -> bytes:
        assert self._socket is not None
        try:
            if self._kind == "udpin":
                data, self._peer = self._socket.recvfrom(MOST)
                return data
            data = self._socket.recv(MOST)
        except OSError:  # nobody listens there (yet)
            data = b""
        if not data and self._kind.startswith("tcp"):
            self._socket.close()
            self._socket = None
        return data

    def _counted(self, message: Message) -> bool:
        if message.get_type() == "BAD_DATA":
            return False
        source = message.get_srcSystem(), message.get_srcComponent()
        number = message.get_seq()
        gap = (number - self._next.get(source, number)) % 256
        self._next[source] = (number + 1) % 256
        self.lost[source] = self.lost.get(source, 0) + gap
        self.received[source] = self.received.get(source, 0) + 1
        return True

    def _open(self) -> None:
        if self._kind.startswith("udp"):
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            (self._socket.bind if self._kind == "udpin" else self._socket.connect)(self._address)
        elif self._kind == "tcpin":
            self._listener = socket.create_server(self._address)
        else:
            deadline = monotonic() + PATIENCE
            while self._socket is None:
                self._connect()
                if self._socket is None and monotonic() > deadline:
                    raise SystemExit(f"nobody listens at {self._address}")
                sleep(0 if self._socket else RETRY)

    def _connect(self) -> None:
        with suppress(OSError):
            self._socket = socket.create_connection(self._address, timeout=PATIENCE)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _parsed(url: str) -> tuple[str, tuple[str, int]]:
    kind, _, rest = url.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in KINDS or not host or not port.isdecimal():
        print(f"{url!r} is no address such as {' '.join(f'{each}:127.0.0.1:14550' for each in KINDS)}", file=sys.stderr)
        raise SystemExit(2)
    return kind, (host, int(port))
