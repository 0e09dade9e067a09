from __future__ import annotations

import errno
import socket

import pytest

from riot_bus.doctor import checks as doctor
from riot_bus.doctor import host
from riot_bus.doctor.checks import Facts, check, judge
from riot_bus.doctor.host import PortState, Runtime, SharedMemory
from riot_bus.zenoh.scouting import Answer

GOOD = {"eclipse-zenoh": "1.10.2", "mcap": "1.6.0"}


def one(name: str, **facts: object) -> doctor.Check:
    return next(each for each in judge(Facts(**{"versions": GOOD, **facts})) if each.name.startswith(name))  # type: ignore[arg-type]


def test_all_is_well() -> None:
    assert {each.status for each in judge(Facts(versions=GOOD, ports=[PortState("tcp/a:1", "free")]))} == {"ok"}
    assert all(not each.cure for each in judge(Facts(versions=GOOD)))


@pytest.mark.parametrize(
    ("name", "facts", "status", "cure"),
    [
        ("versions", {"python": (3, 10)}, "problem", "Python 3.11"),
        ("versions", {"versions": {"eclipse-zenoh": None}}, "problem", "pip install eclipse-zenoh"),
        ("versions", {"versions": {"eclipse-zenoh": "1.9.0"}}, "problem", "eclipse-zenoh>=1.10"),
        ("versions", {"versions": {"eclipse-zenoh": "1.11.0"}}, "warning", "measured with Zenoh 1.10"),
        ("ZENOH_RUNTIME", {"runtime": Runtime("warning", "few", "set it")}, "warning", "set it"),
        ("multicast", {"answers": None}, "warning", "interface"),
        (
            "multicast",
            {"answers": {"a": Answer("a", "peer", ("tcp/b:1",), "lo")}},
            "warning",
            "scouting/multicast/enabled",
        ),
        ("multicast", {"answers": {"a": Answer("a", "client", (), "lo")}}, "ok", ""),
        ("shared", {"memory": SharedMemory("/s", 64 << 20, 1 << 20, 0)}, "warning", "--shm-size"),
        ("shared", {"memory": SharedMemory("/s", 9 << 30, 9 << 30, 5000)}, "warning", "delete /s/*.zenoh"),
        ("shared", {"memory": SharedMemory("/s", 9 << 30, 9 << 30, 1)}, "ok", ""),
        ("open files", {"files": 256}, "warning", "ulimit"),
        ("processors", {"processors": 1}, "warning", "two"),
        ("port", {"ports": [PortState("tcp/a:1", "taken", "zenohd (pid 3)")]}, "problem", "another endpoint"),
        ("port", {"ports": [PortState("tcp/a:1", "elsewhere")]}, "problem", "own address"),
        ("port", {"ports": [PortState("tcp/a:1", "denied")]}, "problem", "1023"),
        ("port", {"ports": [PortState("udp/a:1", "other")]}, "ok", ""),
    ],
)
def test_what_is_wrong_is_named_with_its_cure(name: str, facts: dict[str, object], status: str, cure: str) -> None:
    found = one(name, **facts)
    assert found.status == status
    assert cure in found.cure
    assert bool(found.cure) == (status != "ok")


def test_ports_are_tried() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        taken = host.port(endpoint)
        assert taken.state == "taken"
        assert "pid" in taken.owner
    assert host.port(endpoint).state == "free"
    assert host.port("tcp/192.0.2.254:1").state == "elsewhere"
    assert host.port("tcp/no.such.host.invalid:1").state == "elsewhere"
    assert host.port("unixsock-stream/x").state == "other"


def test_what_is_behind_the_hash_of_an_endpoint_is_not_told() -> None:
    facts = Facts(versions=GOOD, ports=[PortState("tls/a:1#key=secret", "free")])
    assert [each.name for each in judge(facts) if each.name.startswith("port")] == ["port tls/a:1#..."]


def test_a_privileged_port_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: socket.socket, address: object) -> None:
        raise OSError(errno.EACCES, "denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    assert host.port("tcp/127.0.0.1:80").state == "denied"


def test_the_runtime_is_judged_as_the_bus_would(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", "(rx: (worker_threads: 2))")
    assert host.runtime().status == "warning"
    monkeypatch.setenv("ZENOH_RUNTIME", "(rx: (worker_threads: 16))")
    assert host.runtime().status == "ok"


def test_this_host_can_be_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [each.name for each in check(endpoints=["tcp/127.0.0.1:1"], scouting=None)]
    assert names[:2] == ["versions", "ZENOH_RUNTIME"]
    assert names[-1] == "port tcp/127.0.0.1:1"

    def broken(how: object) -> None:
        raise OSError("no network")

    monkeypatch.setattr(doctor, "scout", broken)
    assert {each.name: each.status for each in check()}["multicast scouting"] == "warning"
