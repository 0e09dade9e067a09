"""TCP and serial links, with real sockets and pseudo-terminals."""

from __future__ import annotations

import os
import socket
import tty
from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until
from tests.unit.riot_bus_bridges.links.hosts import WAIT_S, KeepingHost, address_of


def connect(where: str) -> socket.socket:
    return socket.create_connection(address_of(where), timeout=WAIT_S)


def exactly(made: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = made.recv(min(1 << 16, count - len(data)))
        assert part
        data += part
    return data


def test_a_server_has_many_clients() -> None:
    with KeepingHost() as host:
        link = host.open("tcpin:127.0.0.1:0")
        with connect(link.where) as one, connect(link.where) as two:
            assert host.wait(lambda: len(host.ends) == 2)
            assert wait_until(lambda: link.state == "connected", WAIT_S)
            one.sendall(b"one")
            two.sendall(b"two")
            assert host.wait(lambda: sorted(host.data.values()) == [b"one", b"two"])
            for end in host.ends:
                end.send(b"all")
            assert (exactly(one, 3), exactly(two, 3)) == (b"all", b"all")
        assert host.wait(lambda: host.ends == [])
        assert wait_until(lambda: link.state == "listening", WAIT_S)
        with pytest.raises(EnvironmentFaultError, match="cannot listen"):
            host.open(f"tcpin:{link.where}")


def test_the_number_of_clients_is_bounded() -> None:
    with KeepingHost() as host:
        link = host.open("tcpin:127.0.0.1:0")
        clients = [connect(link.where) for _ in range(66)]
        assert host.wait(lambda: len(host.warnings) >= 1)
        assert len(host.ends) == 64
        for each in clients:
            each.close()
        assert host.wait(lambda: host.ends == [])


def test_a_server_on_all_addresses_has_clients_of_both_kinds() -> None:
    with KeepingHost() as host:
        try:
            link = host.open("tcpin:[::]:0")
        except EnvironmentFaultError:
            pytest.skip("there is no IPv6")
        port = int(link.where.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), WAIT_S), socket.create_connection(("::1", port), WAIT_S):
            assert host.wait(lambda: len(host.ends) == 2)


def test_connections_end_when_nobody_acknowledges_any_more() -> None:
    with KeepingHost() as host:
        link = host.open("tcpin:127.0.0.1:0?timeout=1")
        with connect(link.where) as stuck:
            assert host.wait(lambda: len(host.ends) == 1)
            (end,) = host.ends
            while not end.lost:
                end.send(bytes(250))
            assert host.wait(lambda: host.ends == [])
            assert stuck.fileno() >= 0


def test_a_client_connects_again_by_itself() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"127.0.0.1:{server.getsockname()[1]}"
        server.settimeout(WAIT_S)
        host = KeepingHost()
        with host:
            link = host.open(f"tcp:{where}")
            for number in range(3):
                accepted, _ = server.accept()
                with accepted:
                    assert host.wait(lambda: len(host.ends) == 1)
                    assert wait_until(lambda: link.state == "connected", WAIT_S)
                    accepted.sendall(b"%d" % number)
                    assert host.wait(lambda number=number: host.data.get(where, b"").endswith(b"%d" % number))
                    host.ends[0].send(b"there")
                    assert exactly(accepted, 5) == b"there"
                assert host.wait(lambda: host.ends == [])
            assert host.data[where] == b"012"
            assert "disconnected; it is tried again" in host.warnings


def test_a_client_waits_for_its_server() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with KeepingHost() as host:
        link = host.open(f"tcp:127.0.0.1:{port}")
        assert host.wait(lambda: host.warnings == ["Connection refused; it is tried again"])
        assert link.state == "connecting"
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(WAIT_S)
            accepted, _ = server.accept()
            accepted.close()
        assert host.wait(lambda: "disconnected; it is tried again" in host.warnings)


def test_slow_receivers_lose_whole_frames() -> None:
    frame = bytes(range(250))
    with KeepingHost() as host:
        link = host.open("tcpin:127.0.0.1:0")
        with connect(link.where) as slow:
            assert host.wait(lambda: len(host.ends) == 1)
            (end,) = host.ends
            while not end.lost:
                end.send(frame)
            assert end.out * len(frame) > 1 << 18
            assert exactly(slow, end.out * len(frame)) == frame * end.out
            sent, lost = end.out, end.lost
            end.send(frame)
            assert exactly(slow, len(frame)) == frame
            assert (end.out, end.lost) == (sent + 1, lost)


def test_a_device_is_opened_again_when_it_comes_back(tmp_path: Path) -> None:
    device = tmp_path / "ttyTEST"
    with KeepingHost() as host:
        link = host.open(f"serial:{device}:115200")
        assert link.state == "connecting"
        for number in range(2):
            master, slave = os.openpty()
            tty.setraw(slave)
            device.symlink_to(os.ttyname(slave))
            assert host.wait(lambda: len(host.ends) == 1)
            assert wait_until(lambda: link.state == "connected", WAIT_S)
            os.write(master, b"in %d" % number)
            assert host.wait(lambda number=number: host.data.get(link.where, b"").endswith(b"in %d" % number))
            host.ends[0].send(b"out")
            assert os.read(master, 10) == b"out"
            device.unlink()
            os.close(slave)
            os.close(master)
            assert host.wait(lambda: host.ends == [])
        assert "unplugged; it is tried again" in host.warnings
