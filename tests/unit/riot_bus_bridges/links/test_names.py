"""Addresses of hosts."""

from __future__ import annotations

import queue
import socket

import pytest

from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.links.names import Place, look_up, place_of
from riot_bus_bridges.mavlink.url import parse_link

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
