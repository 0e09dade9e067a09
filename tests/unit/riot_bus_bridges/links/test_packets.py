"""Packets that are fetched many at a time, with real sockets: as if one by one."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from riot_bus_bridges.links import packets
from riot_bus_bridges.links.packets import Packets

LOCAL = {socket.AF_INET: "127.0.0.1", socket.AF_INET6: "::1"}


@pytest.fixture(params=["at once", "one by one", "ENOSYS", "EPERM"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """How they are fetched: as this system does, as one without the call does, as one that refuses it does."""

    def refuse(*arguments: Any) -> int:
        packets.ctypes.set_errno(getattr(errno, request.param))
        return -1

    if request.param != "at once":
        monkeypatch.setattr(packets, "_recvmmsg", lambda: None if request.param == "one by one" else refuse)
    return str(request.param)


@pytest.fixture(params=["IPv4", "IPv6"])
def sockets(request: pytest.FixtureRequest) -> Iterator[tuple[socket.socket, socket.socket, socket.socket]]:
    """One that receives, and two that send."""
    family = socket.AF_INET if request.param == "IPv4" else socket.AF_INET6
    made = [socket.socket(family, socket.SOCK_DGRAM) for _ in range(3)]
    try:
        made[0].settimeout(0)
        made[0].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        for each in made:
            try:
                each.bind((LOCAL[family], 0))
            except OSError as error:
                pytest.skip(f"there is no {request.param}: {error}")
        yield made[0], made[1], made[2]
    finally:
        for each in made:
            each.close()


def test_they_come_in_their_order_in_runs_of_one_sender(
    way: str, sockets: tuple[socket.socket, socket.socket, socket.socket]
) -> None:
    here, one, other = sockets
    fetched = Packets(here)
    assert fetched.receive() == []
    sent = [(one, b"a"), (one, b""), (other, b"c" * 60_000), (one, b"d"), (one, b"e")]
    for sender, data in sent:
        sender.sendto(data, here.getsockname())
    assert fetched.receive() == [
        (one.getsockname(), [b"a", b""]),
        (other.getsockname(), [b"c" * 60_000]),
        (one.getsockname(), [b"d", b"e"]),
    ]
    assert fetched.receive() == []


def test_what_does_not_fit_comes_next(way: str, sockets: tuple[socket.socket, socket.socket, socket.socket]) -> None:
    here, one, _ = sockets
    fetched, sent = Packets(here), [b"%d" % number for number in range(150)]
    for data in sent:
        one.sendto(data, here.getsockname())
    turns = [fetched.receive() for _ in range(4)]
    assert [len(run) for run in turns] == [1, 1, 1, 0]
    assert [data for turn in turns for _, run in turn for data in run] == sent
    # What is there still from before does not mix with what is new.
    one.sendto(b"x", here.getsockname())
    assert fetched.receive() == [(one.getsockname(), [b"x"])]


def test_answers_that_nobody_was_there_are_no_packets(way: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind(("127.0.0.1", 0))
        place = gone.getsockname()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there,
    ):
        here.settimeout(0)
        here.connect(place)
        here.send(b"?")
        fetched = Packets(here)
        assert fetched.receive() == []
        here.send(b"?")
        there.bind(place)
        there.sendto(b"!", here.getsockname())
        assert fetched.receive() == [(place, [b"!"])]
