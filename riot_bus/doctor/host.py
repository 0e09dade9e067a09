"""Facts about this host for the doctor."""

from __future__ import annotations

import errno
import os
import socket
import sys
import warnings
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from riot_bus.graph.processes import command, endpoint_of
from riot_bus.zenoh.session import prepare_runtime

_PACKAGES = ("riot-bus", "eclipse-zenoh", "mcap", "numpy", "psutil", "pydantic")
_SHARED = Path("/dev/shm")  # noqa: S108 - Zenoh's own place


@dataclass(frozen=True, slots=True)
class Runtime:
    """Assessment of the current `ZENOH_RUNTIME` by the bus."""

    status: Literal["ok", "warning", "problem"] = "ok"
    text: str = ""
    cure: str = ""


@dataclass(frozen=True, slots=True)
class PortState:
    """Whether a process can listen on an endpoint; `elsewhere`: not an address of this machine, `other`: not TCP."""

    endpoint: str
    state: Literal["free", "taken", "elsewhere", "denied", "other"]
    owner: str = ""


@dataclass(frozen=True, slots=True)
class SharedMemory:
    """The file system of Zenoh's shared memory: sizes in bytes, and the number of Zenoh files in it."""

    path: str
    total: int
    free: int
    left_over: int


def python() -> tuple[tuple[int, int], int]:
    """Return the interpreter's version, and the number of processors that this process may use."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return (sys.version_info.major, sys.version_info.minor), processors


def versions() -> dict[str, str | None]:
    """Return the installed versions of required packages, None for missing ones."""
    found: dict[str, str | None] = {}
    for package in _PACKAGES:
        found[package] = None
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def runtime() -> Runtime:
    """Prepare Zenoh's threads and return the bus's assessment of `ZENOH_RUNTIME`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        prepare_runtime()
    if caught:
        text, _, cure = str(caught[0].message).partition("; ")
        return Runtime("warning", text, cure)
    return Runtime("ok", os.environ.get("ZENOH_RUNTIME", ""))


def port(endpoint: str) -> PortState:
    """Return whether a process could listen on an endpoint now."""
    address = endpoint_of(endpoint)
    if address is None:
        return PortState(endpoint, "other")
    host, number = address
    try:
        families = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except OSError:
        return PortState(endpoint, "elsewhere")
    family, kind, protocol, _, bound = families[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # an ended listener's connections do not count
        try:
            probe.bind(bound)
            probe.listen(1)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return PortState(endpoint, "taken", _listener(number))
            return PortState(endpoint, "denied" if error.errno == errno.EACCES else "elsewhere")
    return PortState(endpoint, "free")


def _listener(number: int) -> str:
    import psutil

    with suppress(psutil.Error, OSError):
        for each in psutil.net_connections(kind="tcp"):
            if each.pid and each.laddr and each.status == psutil.CONN_LISTEN and each.laddr.port == number:
                return f"{command(each.pid) or 'process'} (pid {each.pid})"
    return ""


def shared_memory() -> SharedMemory | None:
    """Return the state of the shared memory file system, None if there is none."""
    with suppress(OSError):
        state = os.statvfs(_SHARED)
        left_over = sum(1 for each in _SHARED.iterdir() if each.suffix == ".zenoh")
        total, free = state.f_blocks * state.f_frsize, state.f_bavail * state.f_frsize
        return SharedMemory(str(_SHARED), total, free, left_over)
    return None


def open_files() -> int | None:
    """Return how many files a process may open, None if unlimited."""
    try:
        import resource
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return None if soft == resource.RLIM_INFINITY else soft
