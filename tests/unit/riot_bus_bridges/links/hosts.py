"""A host of links for tests: it keeps what comes."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Self

from riot_bus_bridges.links.end import End
from riot_bus_bridges.links.link import Link
from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.links.opening import open_link
from riot_bus_bridges.mavlink.url import LinkSpec, parse_link
from riot_bus_mavlink.dialect import load_dialect

WAIT_S = 20.0


class KeepingHost:
    """Opens links and keeps what they say, with a bell."""

    def __init__(self) -> None:
        self.loop = Loop()
        self.crc_extra: Callable[[int], int | None] = load_dialect("common").crc_extra
        self.ends: list[End] = []
        self.data: dict[str, bytes] = {}
        self.warnings: list[str] = []
        self._links: list[Link] = []
        self._bell = threading.Condition()

    def join(self, end: End) -> None:
        with self._bell:
            self.ends = [*self.ends, end]
            self._bell.notify_all()

    def leave(self, end: End) -> None:
        with self._bell:
            self.ends = [each for each in self.ends if each is not end]
            self._bell.notify_all()

    def receive(self, end: End, packets: Sequence[bytes]) -> None:
        with self._bell:
            self.data[end.address] = self.data.get(end.address, b"") + b"".join(packets)
            self._bell.notify_all()

    def warn(self, spec: LinkSpec, text: str) -> None:
        with self._bell:
            self.warnings.append(text)
            self._bell.notify_all()

    def open(self, text: str) -> Link:
        link = open_link(parse_link(text), self)
        self._links.append(link)
        return link

    def wait(self, condition: Callable[[], bool], seconds: float = WAIT_S) -> bool:
        with self._bell:
            return self._bell.wait_for(condition, seconds)

    def __enter__(self) -> Self:
        self.loop.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.loop.stop()
        for link in self._links:
            link.close()
        with suppress(OSError, ValueError):
            self.loop.close()


def udp_socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(WAIT_S)
    return made


def address_of(where: str) -> tuple[str, int]:
    host, _, port = where.rpartition(":")
    return host, int(port)
