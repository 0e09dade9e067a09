"""What all links have in common."""

from __future__ import annotations

import errno
import queue
import socket

import pytest

from riot_bus_bridges.links.link import Link, Place, cannot_listen, look_up, place_of
from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.mavlink.url import parse_link
from tests.unit.riot_bus_bridges.links.hosts import KeepingHost

SPEC = parse_link("tcpin:127.0.0.1:5760")


def test_the_state_tells_whether_a_link_has_an_end() -> None:
    host = KeepingHost()
    link = Link(SPEC, host)
    assert (link.state, link.where, link.dropped()) == ("listening", "127.0.0.1:5760", 0)
    ends = [link.join(address, lambda data: True) for address in ("one", "two")]
    assert host.ends == ends
    assert link.state == "connected"
    link.leave(ends[0])
    assert host.ends == ends[1:]
    link.close()
    assert (host.ends, link.state) == ([], "listening")
    host.loop.close()


def test_an_error_says_what_to_do() -> None:
    error = cannot_listen(SPEC, OSError(errno.EADDRINUSE, "Address already in use"))
    assert "cannot listen: Address already in use" in str(error)
    assert "another port" in str(error.hint)
    assert cannot_listen(SPEC, OSError(errno.EACCES, "Permission denied")).hint is None


SIX = (socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("::1", 14550, 0, 0))
FOUR = (socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("127.0.0.1", 14550))


def test_names_of_both_kinds_of_addresses_stand_for_ipv4(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "getaddrinfo", lambda *args, **options: [SIX, FOUR])
    assert place_of("localhost", 14550, socket.SOCK_DGRAM) == (socket.AF_INET, ("127.0.0.1", 14550))
    monkeypatch.setattr(socket, "getaddrinfo", lambda *args, **options: [SIX])
    assert place_of("::1", 14550, socket.SOCK_DGRAM) == (socket.AF_INET6, ("::1", 14550, 0, 0))


def test_names_are_looked_up_later_and_addresses_at_once() -> None:
    loop = Loop()
    places: queue.Queue[Place] = queue.Queue()
    errors: queue.Queue[OSError] = queue.Queue()
    look_up(loop, parse_link("tcp:127.0.0.1:1"), socket.SOCK_STREAM, found=places.put, failed=errors.put)
    assert places.get_nowait() == (socket.AF_INET, ("127.0.0.1", 1))
    loop.start()
    try:
        look_up(loop, parse_link("tcp:localhost:2"), socket.SOCK_STREAM, found=places.put, failed=errors.put)
        assert places.get(timeout=20) == (socket.AF_INET, ("127.0.0.1", 2))
        look_up(loop, parse_link("tcp:nobody.invalid:3"), socket.SOCK_STREAM, found=places.put, failed=errors.put)
        assert errors.get(timeout=60)
    finally:
        loop.close()
