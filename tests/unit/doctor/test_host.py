"""Facts about a host; the operating system is a fake."""

from __future__ import annotations

import errno
import os
import socket
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from riot_bus.doctor import host
from riot_bus.doctor.host import PortState, Runtime


class Socket:
    """A socket whose binding fails with an error number, if there is one."""

    problem: int | None = None
    bound: tuple[str, int] | None = None

    def __init__(self, *_: object) -> None:
        pass

    def __enter__(self) -> Socket:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def setsockopt(self, *option: object) -> None:
        assert option == (socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)

    def bind(self, address: tuple[str, int]) -> None:
        type(self).bound = address

    def listen(self, _: int) -> None:
        if self.problem is not None:
            raise OSError(self.problem, "")


@pytest.fixture(autouse=True)
def _host(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Socket, "problem", None)
    monkeypatch.setattr(host.socket, "socket", Socket)
    listening = SimpleNamespace(pid=7, laddr=SimpleNamespace(port=7447), status=psutil.CONN_LISTEN)
    others = [
        SimpleNamespace(pid=8, laddr=SimpleNamespace(port=7447), status="ESTABLISHED"),
        SimpleNamespace(pid=None, laddr=SimpleNamespace(port=7447), status=psutil.CONN_LISTEN),
        SimpleNamespace(pid=9, laddr=(), status=psutil.CONN_LISTEN),
    ]
    monkeypatch.setattr(psutil, "net_connections", lambda kind: [*others, listening])
    monkeypatch.setattr(host, "command", {7: "zenohd"}.get)


@pytest.mark.parametrize(
    ("problem", "state"), [(None, "free"), (errno.EACCES, "denied"), (errno.EADDRNOTAVAIL, "elsewhere")]
)
def test_whether_one_could_listen(monkeypatch: pytest.MonkeyPatch, problem: int | None, state: str) -> None:
    monkeypatch.setattr(Socket, "problem", problem)
    assert host.port("tcp/127.0.0.1:7447") == PortState("tcp/127.0.0.1:7447", state)  # type: ignore[arg-type]
    assert Socket.bound == ("127.0.0.1", 7447)


def test_who_listens_already_is_told_as_far_as_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Socket, "problem", errno.EADDRINUSE)
    assert host.port("tls/127.0.0.1:7447") == PortState("tls/127.0.0.1:7447", "taken", "zenohd (pid 7)")
    assert host.port("tcp/127.0.0.1:7448").owner == ""
    monkeypatch.setattr(host, "command", lambda pid: "")
    assert host.port("tcp/127.0.0.1:7447").owner == "process (pid 7)"

    def denied(kind: str) -> Any:
        raise psutil.AccessDenied

    monkeypatch.setattr(psutil, "net_connections", denied)
    assert host.port("tcp/127.0.0.1:7447") == PortState("tcp/127.0.0.1:7447", "taken")


def test_what_is_no_address_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object, **__: object) -> Any:
        raise socket.gaierror

    monkeypatch.setattr(host.socket, "getaddrinfo", unknown)
    assert host.port("tcp/robot.example:1").state == "elsewhere"
    assert host.port("udp/127.0.0.1:1").state == host.port("serial//dev/tty").state == "other"


def test_shared_memory_counts_what_zenoh_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("a.zenoh", "b.zenoh", "sem.other"):
        (tmp_path / name).touch()
    monkeypatch.setattr(host, "_SHARED", tmp_path)
    state = SimpleNamespace(f_blocks=100, f_frsize=4096, f_bavail=25)
    monkeypatch.setattr(os, "statvfs", lambda _: state)
    found = host.shared_memory()
    assert found is not None
    assert (found.path, found.total, found.free, found.left_over) == (str(tmp_path), 409_600, 102_400, 2)
    monkeypatch.setattr(host, "_SHARED", tmp_path / "none")
    assert host.shared_memory() is None


def test_the_bus_assesses_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "prepare_runtime", lambda: warnings.warn("too few; set it; so", stacklevel=1))
    assert host.runtime() == Runtime("warning", "too few", "set it; so")
    monkeypatch.setattr(host, "prepare_runtime", lambda: None)
    monkeypatch.setenv("ZENOH_RUNTIME", "(rx: 9)")
    assert host.runtime() == Runtime("ok", "(rx: 9)")


def test_missing_packages_have_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "_PACKAGES", ("numpy", "no-such-package-of-anybody"))
    found = host.versions()
    assert found["no-such-package-of-anybody"] is None
    assert str(found["numpy"])[0].isdigit()


def test_limits_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    resource = pytest.importorskip("resource")
    for soft, files in ((256, 256), (resource.RLIM_INFINITY, None)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, soft=soft: (soft, resource.RLIM_INFINITY))
        assert host.open_files() == files
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 3}, raising=False)
    assert host.python()[1] == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert host.python()[1] == 1
