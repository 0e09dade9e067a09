from __future__ import annotations

import socket

import pytest

from riot_bus.processes import ros_domains as ros_bridge
from riot_bus.processes.ros_domains import free_domains
from riot_bus.vocabulary.errors import EnvironmentFaultError


def test_domains_are_taken_as_ros_takes_them_and_given_back() -> None:
    with free_domains(2) as found:
        assert len(set(found)) == 2
        for number in found:
            with socket.socket() as lock, pytest.raises(OSError, match="in use"):
                lock.bind(("", 32768 + number))
    with socket.socket() as lock:
        lock.bind(("", 32768 + found[0]))


@pytest.mark.parametrize(("kind", "port"), [(socket.SOCK_STREAM, 32768 + 77), (socket.SOCK_DGRAM, 7400 + 250 * 77)])
def test_a_domain_in_use_is_not_taken(kind: socket.SocketKind, port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_bridge, "_DOMAINS", range(77, 78))
    with socket.socket(type=kind) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("", port))
        with pytest.raises(EnvironmentFaultError, match="are in use"), free_domains(1):
            pass
