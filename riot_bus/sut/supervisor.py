"""The process that owns a trial's components, so that none outlives riot.

It runs as a script of its own (standard library only, one thread) and talks JSON lines over a socket on file
descriptor 0. When riot dies, even by `kill -9`, the socket ends and everything that was started is killed. Children
also carry PR_SET_PDEATHSIG in case the supervisor itself is killed, and grandchildren that were orphaned come to it
as their sub-reaper.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import socket
import subprocess
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


PR_SET_PDEATHSIG = 1
PR_SET_CHILD_SUBREAPER = 36
ADDR_NO_RANDOMIZE = 0x0040000

_libc = ctypes.CDLL(None, use_errno=True)
_prctl = _libc.prctl


IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def become_component() -> None:
    """Take signals as usual again, and ask the kernel for death with the parent (runs between fork and exec)."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_DFL)
    _prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)


def become_fixed_component() -> None:
    """Become a component whose addresses are the same each time, so that a write out of bounds hits the same each time.

    Where the kernel refuses that, as in some containers, they stay random.
    """
    become_component()
    _libc.personality(_libc.personality(0xFFFFFFFF) | ADDR_NO_RANDOMIZE)


def children_of(parent: int) -> list[int]:
    """Return the processes whose parent is `parent`, zombies included."""
    found = []
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError), open(f"/proc/{name}/stat", "rb") as stat:
                if int(stat.read().rpartition(b")")[2].split()[1]) == parent:
                    found.append(int(name))
    return found


class Supervisor:
    """Starts, signals, reaps and finally kills components on request."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._running: dict[int, subprocess.Popen[bytes]] = {}

    def tell(self, **event: object) -> None:
        """Send one event to riot."""
        self._link.sendall(json.dumps(event).encode() + b"\n")

    def start(self, request: dict[str, Any]) -> None:
        """Start one component in a session of its own."""
        try:
            with open(request["stdout"], "ab") as out, open(request["stderr"], "ab") as err:
                process = subprocess.Popen(
                    request["argv"],
                    env=request["env"],
                    cwd=request["cwd"],
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    start_new_session=True,
                    preexec_fn=become_fixed_component if request["fixed"] else become_component,
                )
        except (OSError, subprocess.SubprocessError) as error:
            self.tell(event="refused", error=str(error))
            return
        self._running[process.pid] = process
        self.tell(event="started", pid=process.pid)

    def reap(self) -> None:
        """Collect what has ended and report components' exit statuses (negative: signal)."""
        for pid, process in list(self._running.items()):
            status = process.poll()
            if status is not None:
                del self._running[pid]
                self.tell(event="exited", pid=pid, status=status)
        for pid in children_of(os.getpid()):
            if pid not in self._running:
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)

    def kill_all(self) -> None:
        """Kill every component and all their descendants, and wait until they are gone."""
        for pid in list(self._running):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
        while children := children_of(os.getpid()):
            for pid in children:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            for pid in children:
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, 0)
        self._running.clear()

    def handle(self, request: dict[str, Any]) -> None:
        """Carry out one request."""
        match request["do"]:
            case "start":
                self.start(request)
            case "signal":
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(request["pid"], request["signal"])
            case "kill_all":
                self.kill_all()
                self.tell(event="killed")

    def serve(self) -> None:
        """Work until riot is gone."""
        wake_read, wake_write = os.pipe()
        os.set_blocking(wake_read, False)
        os.set_blocking(wake_write, False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(wake_write, warn_on_full_buffer=False)
        pending = b""
        while True:
            readable, _, _ = select.select([self._link.fileno(), wake_read], [], [])
            if wake_read in readable:
                with contextlib.suppress(BlockingIOError):
                    os.read(wake_read, 4096)
                self.reap()
            if self._link.fileno() in readable:
                received = self._link.recv(1 << 16)
                if not received:
                    return
                *lines, pending = (pending + received).split(b"\n")
                for line in lines:
                    self.handle(json.loads(line))


def main() -> int:
    """Serve the socket on file descriptor 0 until it ends."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    _prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    supervisor = Supervisor(socket.socket(fileno=0))
    try:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            supervisor.serve()
    finally:
        supervisor.kill_all()
    return 0


if __name__ == "__main__":
    sys.exit(main())
