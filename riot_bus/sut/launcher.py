"""Starting and supervising components from riot's side (see `supervisor` for the other)."""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.sut.forking import Fork
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["TORN_DOWN_WITHIN_S", "ComponentProcess", "Launcher"]

_LOG = logging.getLogger(__name__)
_SUPERVISOR = Path(__file__).with_name("supervisor.py")
_TICKS = os.sysconf("SC_CLK_TCK")
TORN_DOWN_WITHIN_S = 30.0
"""An engine removes a container within one of them; what takes longer is killed."""
_HALF = 8 << 20
"""Bytes of the begin, and of the end, that are read of what a component writes to one stream."""
_SIGNALLED, _LAST_SIGNALLED = 129, 128 + 64


@dataclass(slots=True)
class ComponentProcess:
    """One started component.

    Attributes:
        started: "forked" or "executed", with the reason where a Python program was not forked.
        status: Exit status, negative for a signal, None while it runs.
        stack: File and function of each native frame on which a signal has ended it, the innermost first.
        excess: Of what it had more than it may, for which it was killed, and how much.
        relayed: Whether its status is told by another program, as a shell tells it: 128 and the number of a signal.
        torn_down: Whether nothing is left to be done after its end.
    """

    name: str
    pid: int
    stdout: Path
    stderr: Path
    started: str = "executed"
    status: int | None = None
    stack: Sequence[tuple[str, str]] = ()
    excess: tuple[str, float] | None = None
    relayed: bool = False
    torn_down: bool = True

    def errors(self) -> str:
        """Return what it has written to stderr; of more than 16 MiB, the begin and the end."""
        return _text(self.stderr)

    def printed(self) -> str:
        """Return what it has written to stdout; of more than 16 MiB, the begin and the end."""
        return _text(self.stdout)

    @property
    def unread(self) -> int:
        """Bytes between the begin and the end of what it has written that are left out."""
        return sum(max(0, path.stat().st_size - 2 * _HALF) for path in (self.stdout, self.stderr))


def _text(path: Path) -> str:
    with path.open("rb") as stream:
        end = stream.seek(0, 2)
        stream.seek(0)
        text = stream.read(_HALF)
        if end > 2 * _HALF:
            stream.seek(end - _HALF)
            text += b"\n"
        text += stream.read(_HALF)
    return text.decode(errors="replace")


class Launcher:
    """Starts components and sees to it that none is left behind. Usable from several threads.

    Args:
        slot: Number of the trial among those that run at once.
        quiet: Whether nothing is written to the stdout of this process.
        scratch: A folder that is removed in the end, even if this process is killed.
    """

    def __init__(self, slot: int = 0, *, quiet: bool = True, scratch: Path | None = None) -> None:
        self.slot = slot
        ours, theirs = socket.socketpair()
        self._link = ours
        self._pending: bytes = b""
        self._lock = threading.RLock()
        self._processes: dict[int, ComponentProcess] = {}
        self._replies: list[dict[str, object]] = []
        self._ended: list[dict[str, Any]] = []
        self._servers: dict[tuple[object, ...], int] = {}
        self._supervisor = subprocess.Popen(
            [sys.executable, "-S", "-E", str(_SUPERVISOR), *([str(scratch)] if scratch is not None else [])],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL if quiet else None,
            start_new_session=True,
        )
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(
        self,
        name: str,
        argv: Sequence[str],
        *,
        env: Mapping[str, str],
        cwd: Path,
        directory: Path | None,
        fixed: bool = False,
        fork: Fork | str | None = None,
        limits: Mapping[str, float] | None = None,
        held: bool = False,
        teardown: Sequence[str] = (),
        undoes: bool = False,
        relayed: bool = False,
    ) -> ComponentProcess:
        """Start a component; its output goes to `<directory>/<name>.out` and `.err`, or to that of this process.

        Args:
            name: What it is called.
            argv: Its command.
            env: Its whole environment.
            cwd: Its working folder.
            directory: Folder for its output; None to leave it where this process writes to, if that is not `quiet`.
            fixed: Whether addresses are the same each time, as far as the kernel allows it.
            fork: How it is forked, or why not; None to execute its command.
            limits: What it may have of the machine (see `resource_limits.Guard`); None for anything.
            held: Whether its standard input stays open until it ends, or riot does; else there is none.
            teardown: Command that is run when it has ended, or riot has, however that came. Its output goes to
                `<directory>/<name>.teardown`.
            undoes: Whether that is only run where it ends with another status than 0, or is ended.
            relayed: See `ComponentProcess`.

        Raises:
            EnvironmentFaultError: The command cannot be executed.
        """
        stdout, stderr = (
            Path(os.devnull) if directory is None else directory / f"{name}.{end}" for end in ("out", "err")
        )
        request = {"do": "start", "argv": list(argv), "env": dict(env), "cwd": str(cwd), "fixed": fixed}
        request |= {"stdout": str(stdout), "stderr": str(stderr)}
        request["ours"] = directory is None
        request["limits"] = dict(limits) if limits else None
        request |= {"held": held, "teardown": list(teardown), "undoes": undoes, "torn_down_within": TORN_DOWN_WITHIN_S}
        request["teardown_output"] = os.devnull if directory is None else str(directory / f"{name}.teardown")
        with self._lock:
            self._send(request | {"fork": self._told(fork) if isinstance(fork, Fork) else None})
            reply = self._reply()
            if reply["event"] == "refused":
                raise EnvironmentFaultError(
                    f"component {name!r} does not start: {reply['error']}",
                    hint=f"check the command {' '.join(argv)!r} in riot.toml; it ran in {cwd}",
                )
            cannot = reply["cannot"] or (fork if isinstance(fork, str) else "")
            started = f"executed, since {cannot}" if cannot else "forked" if fork else "executed"
            process = ComponentProcess(name, int(str(reply["pid"])), stdout, stderr, started, relayed=relayed)
            process.torn_down = not teardown
            self._processes[process.pid] = process
            self._settle_ends()
        return process

    def _told(self, fork: Fork) -> dict[str, object]:
        """Return a fork as the supervisor is told of it: what its server needs goes over once, then by a number."""
        key = (tuple(fork.interpreter), tuple(fork.modules), fork.own, tuple(sorted(fork.env.items())))
        known = key in self._servers
        number = self._servers.setdefault(key, len(self._servers))
        wanted = {name: getattr(fork, name) for name in ("interpreter", "env", "modules", "own")}
        told: dict[str, object] = {"module": fork.module, "words": fork.words, "server": number}
        return told if known else told | {"wanted": wanted}

    def alive(self, process: ComponentProcess) -> bool:
        """Return whether the component still runs."""
        with self._lock:
            self._pump(0.0)
        return process.status is None

    def wait(self, processes: Sequence[ComponentProcess], *, timeout: float, torn_down: bool = False) -> bool:
        """Wait until all of them have ended, and are `torn_down`; False when `timeout` seconds were not enough."""
        deadline = time.monotonic() + timeout
        while any(process.status is None or (torn_down and not process.torn_down) for process in processes):
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                return False
            with self._lock:
                self._pump(min(remaining, 0.05))
        return True

    def watch(self, pids: Sequence[int]) -> str:
        """Have the native stack kept on which a signal ends processes; return why that cannot be, else nothing."""
        with self._lock:
            self._send({"do": "watch", "pids": list(pids)})
            return str(self._reply()["cannot"])

    def include(self, process: ComponentProcess, pids: Sequence[int]) -> None:
        """Have the limits of a component hold for further processes and what they start, such as a container's."""
        with self._lock:
            self._send({"do": "include", "pid": process.pid, "pids": list(pids)})

    def interrupt(self, process: ComponentProcess, number: signal.Signals = signal.SIGTERM) -> None:
        """Send a signal to a component's process group."""
        with self._lock:
            self._send({"do": "signal", "pid": process.pid, "signal": int(number)})

    def cpu(self) -> float:
        """Return the seconds of processors that the supervisor and components that have ended took."""
        with suppress(OSError):
            words = Path(f"/proc/{self._supervisor.pid}/stat").read_text().rpartition(")")[2].split()
            return sum(map(int, words[11:15])) / _TICKS
        return 0.0

    def kill_all(self) -> None:
        """Kill everything that was started, descendants included."""
        with self._lock:
            self._send({"do": "kill_all"})
            self._reply()
            self._processes.clear()
            self._ended.clear()  # of processes that nobody will know; others get their numbers

    def close(self) -> None:
        """Kill everything and end the supervisor."""
        self._link.close()
        self._supervisor.wait(timeout=30 + TORN_DOWN_WITHIN_S)

    def _send(self, request: dict[str, object]) -> None:
        try:
            self._link.sendall(json.dumps(request).encode() + b"\n")
        except OSError as error:
            raise EnvironmentFaultError(f"the supervisor of the components is gone: {error}") from None

    def _reply(self) -> dict[str, object]:
        while not self._replies:
            self._pump(30.0)
        return self._replies.pop(0)

    def _pump(self, timeout: float) -> None:
        readable, _, _ = select.select([self._link], [], [], timeout)
        if not readable:
            return
        received = self._link.recv(1 << 16)
        if not received:
            raise EnvironmentFaultError("the supervisor of the components is gone")
        *lines, self._pending = (self._pending + received).split(b"\n")
        for line in lines:
            event = json.loads(line)
            (self._ended if event["event"] in ("exited", "torn down") else self._replies).append(event)
        self._settle_ends()

    def _settle_ends(self) -> None:
        """Note the ends of processes and of their teardowns; one may come before its process is known here."""
        for event in list(self._ended):
            process = self._processes.get(event["pid"])
            if process is None:
                continue
            self._ended.remove(event)
            if event["event"] == "torn down":
                process.torn_down = True
                if event["problem"]:
                    _LOG.warning("the teardown of component %r failed: %s", process.name, event["problem"])
            else:
                status = event["status"]
                process.status = 128 - status if process.relayed and _SIGNALLED <= status <= _LAST_SIGNALLED else status
                process.stack = tuple((file, name) for file, name in event["stack"])
                process.excess = tuple(event["excess"]) if event["excess"] else None
