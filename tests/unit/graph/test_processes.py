"""Which process owns a socket; psutil is a fake with a kernel's table of a test."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from riot_bus.graph.processes import Connection, SocketOwner, command, connections, endpoint_of, owners


def row(pid: int | None, near: tuple[str, int], far: tuple[str, int] | None, status: str = "ESTABLISHED") -> Any:
    ends = [SimpleNamespace(ip=end[0], port=end[1]) if end else () for end in (near, far)]
    return SimpleNamespace(pid=pid, laddr=ends[0], raddr=ends[1], status=status)


TABLE = [
    row(7, ("127.0.0.1", 50_000), ("127.0.0.1", 7447)),
    row(8, ("::ffff:127.0.0.1", 7447), ("::ffff:127.0.0.1", 50_000)),
    row(None, ("::1", 50_001), ("::1", 7447)),
    row(8, ("0.0.0.0", 7447), None, "LISTEN"),
    row(8, ("127.0.0.1", 50_002), ("127.0.0.1", 7447), "TIME_WAIT"),
]


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> dict[int, list[str]]:
    """Command lines by process id; tests may change them."""
    lines = {7: ["/usr/bin/python3.12", "-u", "/opt/talker.py", "--x"], 8: ["/usr/bin/zenohd", "-c", "a"]}

    class Process:
        def __init__(self, pid: int) -> None:
            if pid not in lines:
                raise psutil.NoSuchProcess(pid)
            self.pid = pid

        def cmdline(self) -> list[str]:
            return lines[self.pid]

        def name(self) -> str:
            return "kernel"

        def net_connections(self, kind: str) -> list[Any]:
            rows = [vars(each) for each in TABLE if each.pid == self.pid]
            return [SimpleNamespace(**{name: value for name, value in each.items() if name != "pid"}) for each in rows]

    monkeypatch.setattr(psutil, "Process", Process)
    monkeypatch.setattr(psutil, "net_connections", lambda kind: TABLE)
    return lines


@pytest.mark.parametrize(
    ("locator", "endpoint"),
    [
        ("tcp/127.0.0.1:7447", ("127.0.0.1", 7447)),
        ("tls/host.example:1?rel=0#ca=x:2", ("host.example", 1)),
        ("ws/[fe80::1%eth0]:80", ("fe80::1%eth0", 80)),
        ("udp/127.0.0.1:7447", None),
        ("tcp/127.0.0.1", None),
        ("tcp/:7447", None),
        ("tcp/host:port", None),
        ("unixsock-stream//tmp/a:1", None),
        ("", None),
    ],
)
def test_host_and_port_of_a_locator(locator: str, endpoint: tuple[str, int] | None) -> None:
    assert endpoint_of(locator) == endpoint


def test_connections_are_established_ones_of_both_ends(host: dict[int, list[str]]) -> None:
    first = Connection(7, ("127.0.0.1", 50_000), ("127.0.0.1", 7447))
    second = Connection(8, ("127.0.0.1", 7447), ("127.0.0.1", 50_000))
    assert connections() == [Connection(0, ("::1", 50_001), ("::1", 7447)), first, second]
    assert connections([7, 8]) == [first, second]
    assert connections([7]) == [first]
    assert connections([99]) == connections([]) == []


def test_owners_are_told_by_locator(host: dict[int, list[str]]) -> None:
    found = owners(["tcp/127.0.0.1:50000", "tcp/127.0.0.1:7447", "tcp/[::1]:50001", "udp/127.0.0.1:50000", "tcp/b:1"])
    assert found == {
        "tcp/127.0.0.1:50000": SocketOwner(7, "talker.py"),
        "tcp/127.0.0.1:7447": SocketOwner(8, "zenohd"),
    }
    assert owners(["udp/127.0.0.1:50000"]) == {}


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["python3", "-m", "pkg.tool", "x"], "pkg.tool"),
        (["python3", "-m"], "python3"),
        (["bash", "-c", "echo\nls"], "bash"),
        (["node"], "node"),
        (["/opt/my nodes/run", "script.py"], "run"),
        ([], "kernel"),
    ],
)
def test_a_process_is_called_by_what_it_runs(host: dict[int, list[str]], words: list[str], name: str) -> None:
    host[7] = words
    assert command(7) == name
    del host[7]
    assert command(7) == ""
