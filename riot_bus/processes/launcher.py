"""Start and supervision of components from riot's side (`supervisor` is the other side)."""

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

from riot_bus.processes.starts import Fork
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_LOG = logging.getLogger(__name__)
_SUPERVISOR = Path(__file__).with_name("supervisor.py")
_TICKS = os.sysconf("SC_CLK_TCK")
TORN_DOWN_WITHIN_S = 30.0
"""Time limit of a teardown, which is killed then; an engine removes a container within a second."""
_HALF = 8 << 20
"""Bytes that are read from the start, and from the end, of a component's output on one stream."""


@dataclass(slots=True)
class ComponentProcess:
    """One started component.

    Attributes:
        started: "forked" or "executed", with the reason if a Python program was not forked.
        status: Exit status, negative for a signal, None while it runs.
        stack: File and function of each native frame at the signal that ended it, the innermost first.
        excess: Resource whose limit it exceeded, for which it was killed, and the amount.
        relayed: Whether another program passes on its status as a shell does: 128 plus the number of a signal.
        torn_down: Whether its teardown is finished, or there is none.
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
        """Return its output on stderr; only the start and the end if it has more than 16 MiB."""
        return _text(self.stderr)

    def printed(self) -> str:
        """Return its output on stdout; only the start and the end if it has more than 16 MiB."""
        return _text(self.stdout)

    @property
    def unread(self) -> int:
        """Number of bytes left out between the start and the end of its outputs."""
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
    """Starts components and ensures that none is left behind; usable from several threads.

    Args:
        slot: Number of the trial among those that run at once.
        scratch: Folder that is removed at the end, even if this process is killed.
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
        script: str | None = None,
        teardown: Sequence[str] = (),
        undoes: bool = False,
        relayed: bool = False,
    ) -> ComponentProcess:
        """Start a component; its output goes to `<directory>/<name>.out` and `.err`, or to that of this process.

        Args:
            directory: Folder for its output; None for the output of this process, unless that is `quiet`.
            fork: Description of its fork server, or the reason why it has none; None to execute its command.
            script: Text on its standard input, which then stays open until it or riot ends; None for no input.
            teardown: Command that is run when the component or riot has ended, for whatever reason. Its output goes to
                `<directory>/<name>.teardown`.
            undoes: Whether to run the teardown only if the component ends with a status other than 0, or is killed.

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
        request |= {"script": script, "teardown": list(teardown), "undoes": undoes}
        request["torn_down_within"] = TORN_DOWN_WITHIN_S
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
        """Return a fork for the supervisor's request: its server's needs are sent once, and then named by a number."""
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
        """Wait until all have ended, with their teardowns if `torn_down`; return False after `timeout` seconds."""
        deadline = time.monotonic() + timeout
        while any(process.status is None or (torn_down and not process.torn_down) for process in processes):
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                return False
            with self._lock:
                self._pump(min(remaining, 0.05))
        return True

    def watch(self, pids: Sequence[int]) -> str:
        """Record the native stack when a signal ends one of the processes; return why that is impossible, if it is."""
        with self._lock:
            self._send({"do": "watch", "pids": list(pids)})
            return str(self._reply()["cannot"])

    def include(self, process: ComponentProcess, pids: Sequence[int]) -> None:
        """Apply the limits of a component to further processes, such as a container's, and their descendants."""
        with self._lock:
            self._send({"do": "include", "pid": process.pid, "pids": list(pids)})

    def interrupt(self, process: ComponentProcess, number: signal.Signals = signal.SIGTERM) -> None:
        """Send a signal to a component's process group."""
        with self._lock:
            self._send({"do": "signal", "pid": process.pid, "signal": int(number)})

    def cpu(self) -> float:
        """Return the processor time of the supervisor and of ended components, in seconds."""
        with suppress(OSError), open(f"/proc/{self._supervisor.pid}/stat", "rb", buffering=0) as stream:
            words = stream.read().rpartition(b")")[2].split()
            return sum(map(int, words[11:15])) / _TICKS
        return 0.0

    def kill_all(self) -> None:
        """Kill everything that was started, descendants included."""
        with self._lock:
            self._send({"do": "kill_all"})
            self._reply()
            self._processes.clear()
            self._ended.clear()  # of unknown processes, whose ids may be used again

    def close(self) -> None:
        """Kill everything and end the supervisor."""
        with suppress(OSError):  # it is closed, or the supervisor has ended
            # A `select` of another thread would not notice that the socket is closed, and would keep it open.
            self._link.shutdown(socket.SHUT_RDWR)
        self._supervisor.wait(timeout=30 + TORN_DOWN_WITHIN_S)
        with self._lock:
            self._link.close()

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
                signalled = process.relayed and 128 < status < 128 + signal.NSIG  # as shells report signals
                process.status = 128 - status if signalled else status
                process.stack = tuple((file, name) for file, name in event["stack"])
                process.excess = tuple(event["excess"]) if event["excess"] else None
