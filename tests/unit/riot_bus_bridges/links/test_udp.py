"""UDP links, with real sockets."""

from __future__ import annotations

import socket
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until
from tests.unit.riot_bus_bridges.links.hosts import WAIT_S, KeepingHost, address_of, udp_socket

FRAME = b"\xfd\x01\x00\x00\x00\x01\x01\x00\x00\x00\x01\x00\x00"


def test_a_server_answers_all_who_have_sent() -> None:
    with KeepingHost() as host, udp_socket() as one, udp_socket() as two:
        link = host.open("udpin:127.0.0.1:0")
        assert link.state == "listening"
        where = address_of(link.where)
        two.sendto(b"no frame", where)
        one.sendto(FRAME, where)
        assert host.wait(lambda: len(host.ends) == 1)
        host.ends[0].send(b"answer")
        assert one.recv(100) == b"answer"
        two.sendto(FRAME, where)
        assert host.wait(lambda: len(host.ends) == 2)
        for end in host.ends:
            end.send(b"to all")
        assert (one.recv(100), two.recv(100)) == (b"to all", b"to all")
        assert wait_until(lambda: link.state == "connected", WAIT_S)
        assert link.dropped() == 0
        assert host.wait(lambda: set(host.data.values()) == {FRAME})
        assert [end.out for end in host.ends] == [2, 1]
    assert host.ends == []


def test_who_is_silent_is_forgotten() -> None:
    with KeepingHost() as host, udp_socket() as one:
        link = host.open("udpin:127.0.0.1:0?timeout=0.2")
        one.sendto(FRAME, address_of(link.where))
        assert host.wait(lambda: len(host.ends) == 1)
        gone = host.ends[0]
        assert host.wait(lambda: host.ends == [])
        assert wait_until(lambda: link.state == "listening", WAIT_S)
        one.sendto(FRAME, address_of(link.where))
        assert host.wait(lambda: len(host.ends) == 1)
        assert host.ends[0] is not gone


def test_the_number_of_peers_is_bounded() -> None:
    with KeepingHost() as host:
        link = host.open("udpin:127.0.0.1:0")
        sockets = [udp_socket() for _ in range(70)]
        for each in sockets:
            each.sendto(FRAME, address_of(link.where))
        assert host.wait(lambda: len(host.data) == 70)
        assert len(host.ends) == 64
        for each in sockets:
            each.close()


def test_senders_of_one_fetch_are_told_apart() -> None:
    one, other, third = ("127.0.0.1", 1), ("127.0.0.1", 2), ("127.0.0.1", 3)
    with KeepingHost() as host:
        link: Any = host.open("udpin:127.0.0.1:0")
        runs: list[tuple[Any, list[bytes]]] = [
            (one, [FRAME]),
            (other, [b"", b"no frame", FRAME, b"a piece"]),
            (third, [b"no frame"]),
            (one, [b"no frame"]),
        ]
        link._packets = SimpleNamespace(receive=lambda: runs)
        link._read(0)
        assert host.data == {"127.0.0.1:1": FRAME + b"no frame", "127.0.0.1:2": FRAME + b"a piece"}
        many = [(("127.0.0.1", 10 + number), [FRAME]) for number in range(64)]
        runs = [*many, (other, [FRAME])]  # two make room for the first, who come again and make room for others
        link._read(0)
        assert len(host.ends) == 64
        assert host.data["127.0.0.1:2"] == FRAME + b"a piece" + FRAME
        before = dict(host.data)
        runs = [(one, [FRAME]), (other, [FRAME])]
        host.receive = lambda end, packets: link.close()  # type: ignore[method-assign]
        link._read(0)
        assert host.ends == []
        assert host.data == before


def test_a_client_sends_first_and_takes_answers() -> None:
    with KeepingHost() as host, udp_socket() as server:
        link = host.open(f"udpout:127.0.0.1:{server.getsockname()[1]}")
        assert link.state == "connected"
        host.ends[0].send(FRAME)
        data, address = server.recvfrom(100)
        assert data == FRAME
        server.sendto(b"answer", address)
        assert host.wait(lambda: list(host.data.values()) == [b"answer"])


def test_a_client_is_not_stopped_by_nobody_there() -> None:
    with udp_socket() as gone:
        port = gone.getsockname()[1]
    with KeepingHost() as host, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        host.open(f"udpout:127.0.0.1:{port}")
        for _ in range(3):
            host.ends[0].send(FRAME)
        server.bind(("127.0.0.1", port))
        server.settimeout(20)
        host.ends[0].send(FRAME)
        assert server.recv(100) == FRAME


def test_a_broadcast_becomes_an_address_by_its_answer() -> None:
    with (
        KeepingHost() as host,
        udp_socket() as answering,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server,
    ):
        server.bind(("127.255.255.255", 0))
        server.settimeout(20)
        host.open(f"udpout:127.255.255.255:{server.getsockname()[1]}")
        host.ends[0].send(FRAME)
        data, address = server.recvfrom(100)
        assert data == FRAME
        answering.sendto(b"me", ("127.0.0.1", address[1]))
        assert host.wait(lambda: list(host.data.values()) == [b"me"])
        host.ends[0].send(b"you alone")
        assert answering.recv(100) == b"you alone"


def test_a_name_that_is_not_known_is_tried_again() -> None:
    with KeepingHost() as host:
        link = host.open("udpout:no-such-host.invalid:14550")
        assert link.state == "connecting"
        assert host.wait(lambda: len(host.warnings) >= 1)
        assert "tried again" in host.warnings[0]
        assert host.ends == []


def test_names_are_looked_up() -> None:
    with KeepingHost() as host, udp_socket() as server:
        host.open(f"udpout:localhost:{server.getsockname()[1]}")
        assert host.wait(lambda: len(host.ends) == 1)
        host.ends[0].send(FRAME)
        assert host.ends[0].out == 1


def test_a_port_in_use_is_an_error() -> None:
    with KeepingHost() as host, udp_socket() as taken, pytest.raises(EnvironmentFaultError, match="cannot listen"):
        host.open(f"udpin:127.0.0.1:{taken.getsockname()[1]}")


def test_packets_that_nobody_takes_are_counted() -> None:
    with udp_socket() as sender:
        host = KeepingHost()  # its loop does not run
        link = host.open("udpin:127.0.0.1:0")
        for _ in range(40_000):
            sender.sendto(bytes(200), address_of(link.where))
        assert link.dropped() > 0
        link.close()
        assert link.dropped() == 0
        host.loop.close()
