"""Finds the processes of this host that own the ends of links; those of other users show only with privileges."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import PurePath

_INTERPRETERS = ("python", "ruby", "node", "java", "perl", "bash", "sh")


@dataclass(frozen=True, slots=True, order=True)
class SocketOwner:
    """A process that owns a socket."""

    pid: int
    command: str


@dataclass(frozen=True, slots=True, order=True)
class Connection:
    """An established TCP connection as one of its ends sees it; `pid` is 0 if we may not see whose it is."""

    pid: int
    near: tuple[str, int]
    far: tuple[str, int]


def endpoint_of(locator: str) -> tuple[str, int] | None:
    """Return host and port of a locator over TCP, None if it has none.

    Example:
        >>> endpoint_of("tcp/[::1]:7447")
        ('::1', 7447)
    """
    protocol, _, address = locator.partition("/")
    host, _, port = address.split("?")[0].split("#")[0].rpartition(":")
    if protocol not in ("tcp", "tls", "ws") or not host or not port.isdigit():
        return None
    return host.strip("[]"), int(port)


def connections(pids: Collection[int] | None = None) -> list[Connection]:
    """Return the established TCP connections of processes of this host, sorted.

    Args:
        pids: Ids of the processes to look at; None for all.
    """
    import psutil

    # Each question reads the kernel's whole table (10 ms): for more than one process, one for all is cheaper.
    found: list[Connection] = []
    for pid in pids if pids is not None and len(pids) < 2 else (None,):
        with suppress(psutil.Error, OSError):
            each = psutil if pid is None else psutil.Process(pid)
            for one in each.net_connections(kind="tcp"):
                owner = getattr(one, "pid", pid) or 0
                if (
                    one.laddr
                    and one.raddr
                    and one.status == psutil.CONN_ESTABLISHED
                    and (pids is None or owner in pids)
                ):
                    near, far = (_plain(one.laddr.ip), one.laddr.port), (_plain(one.raddr.ip), one.raddr.port)
                    found.append(Connection(owner, near, far))
    return sorted(found)


def _plain(host: str) -> str:
    return host.removeprefix("::ffff:")


def owners(locators: Iterable[str]) -> dict[str, SocketOwner]:
    """Return which process owns each locator; those of other hosts, users and protocols are left out."""
    wanted = {end: locator for locator in locators if (end := endpoint_of(locator)) is not None}
    if not wanted:
        return {}
    found = {wanted[each.near]: each.pid for each in connections() if each.near in wanted and each.pid}
    commands = {pid: command(pid) for pid in set(found.values())}
    return {locator: SocketOwner(pid, commands[pid]) for locator, pid in found.items()}


def command(pid: int) -> str:
    """Return a short name of a process: its program, or the script that it interprets; empty if it is gone."""
    import psutil

    with suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        words = process.cmdline()
        program = PurePath(words[0]).name if words else process.name()
        if program.startswith(_INTERPRETERS):
            if "-m" in words[1:-1]:
                return words[words.index("-m") + 1]
            script = next((word for word in words[1:] if not word.startswith("-")), "")
            return PurePath(script).name if script and "\n" not in script else program
        return program
    return ""
