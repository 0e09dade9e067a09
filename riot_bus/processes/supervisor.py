"""The process that owns a trial's components, so that none outlives riot.

Components are executed, or forked from a server that has imported what they import (`fork_server`), and killed when
they exceed their limits (`resource_limits`). The supervisor runs as a separate script (standard library only, one
thread) and exchanges JSON lines over a socket on file descriptor 0. When riot dies, even by `kill -9`, the socket ends
and everything that was started is killed. Children also have PR_SET_PDEATHSIG in case the supervisor itself is killed,
and it adopts orphaned grandchildren as their subreaper. What does not end with the process of a component, such as a
container, has a command that is run when the component has ended (`teardown`).

The states of a component, with the events that riot is told:

    state        from         by                                        event
    running      -            `start`: executed, or forked              started, or refused
    exceeding    running      its `Guard`: it is killed                 -
    ended        running, exceeding   `reap`: its status and stack      exited
    tearing down ended        its `teardown`, if it has one             -
    torn down    tearing down `reap`: the end of that command           torn down
    gone         any          `kill_all`, or the end of riot            killed
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import time

sys.path.append(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))

from riot_bus.processes.resource_limits import LOOK_S, Guard
from riot_bus.processes.tracing import WALL, Tracer

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


ADDR_NO_RANDOMIZE = 0x0040000
STARTS_WITHIN_S = 60.0
"""Time limit for the imports of a fork server, sufficient also on a loaded machine."""

_libc = ctypes.CDLL(None, use_errno=True)
_prctl = _libc.prctl


IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def become_component() -> None:
    """Take signals as usual again, and ask the kernel for death with the parent (runs between fork and exec)."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_DFL)
    _prctl(1, int(signal.SIGKILL), 0, 0, 0)  # PR_SET_PDEATHSIG


def become_fixed_component() -> None:
    """Become a component whose addresses are the same each time, so that a write out of bounds hits the same each time.

    Where the kernel refuses that, as in some containers, they stay random.
    """
    become_component()
    _libc.personality(_libc.personality(0xFFFFFFFF) | ADDR_NO_RANDOMIZE)


def children_of(parent: int) -> list[int]:
    """Return the processes whose parent is `parent`, which has one thread; zombies included."""
    with contextlib.suppress(OSError), open(f"/proc/{parent}/task/{parent}/children", "rb") as stream:
        return [int(pid) for pid in stream.read().split()]
    found = []  # such a file is an option of the kernel
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError), open(f"/proc/{name}/stat", "rb") as stat:
                if int(stat.read().rpartition(b")")[2].split()[1]) == parent:
                    found.append(int(name))
    return found


class ForkServer:
    """A running `fork_server.py`.

    Args:
        wanted: Description of the server: `interpreter` (a command), `env`, `modules`, `own` (see `forking.Fork`).
        fixed: Whether addresses are the same each time.
    """

    def __init__(self, wanted: dict[str, Any], *, fixed: bool) -> None:
        self._link, theirs = socket.socketpair()
        self._link.settimeout(STARTS_WITHIN_S)
        self._process = subprocess.Popen(
            [*wanted["interpreter"], os.path.join(os.path.dirname(os.path.abspath(__file__)), "fork_server.py")],
            env=wanted["env"],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=become_fixed_component if fixed else become_component,
        )
        theirs.close()
        self.pid = self._process.pid
        self._answers = self._link.makefile("rb")
        self.cannot = ""
        self._ask(modules=wanted["modules"], own=wanted["own"])

    def start(self, **request: object) -> int:
        """Fork a component; return its process number, 0 if it `cannot`."""
        return 0 if self.cannot else int(self._ask(parent=os.getpid(), **request).get("pid", 0))

    def _ask(self, **request: object) -> dict[str, Any]:
        answer = {"cannot": "the fork server has ended"}
        with contextlib.suppress(OSError, ValueError):
            self._link.sendall(json.dumps(request).encode() + b"\n")
            answer = json.loads(self._answers.readline())
        self.cannot = answer.get("cannot", "")
        return answer

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._answers.close()
        self._link.close()


class Supervisor:
    """Starts, signals, reaps and finally kills components on request."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._running: set[int] = set()
        self._wanted: dict[int, dict[str, Any]] = {}
        self._servers: dict[int, ForkServer] = {}
        self._tracer = Tracer()
        self._guards: dict[int, Guard] = {}
        self._excess: dict[int, tuple[str, float]] = {}
        self._held: dict[int, contextlib.ExitStack] = {}
        self._teardowns: dict[int, dict[str, Any]] = {}
        self._ending: dict[int, int] = {}
        self._torn_down_within = 0.0

    def tell(self, **event: object) -> None:
        """Send one event to riot; whether riot is gone is told by the other direction."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._link.sendall(json.dumps(event).encode() + b"\n")

    def start(self, request: dict[str, Any]) -> None:
        """Start one component in a session of its own."""
        try:
            pid, cannot = self.fork(request) if request["fork"] else (0, "")
            pid = pid or self.execute(request)
        except (OSError, subprocess.SubprocessError) as error:
            self.tell(event="refused", error=str(error))
            return
        self._running.add(pid)
        if request["teardown"]:
            self._teardowns[pid] = request
            self._torn_down_within = request["torn_down_within"]
        if request["limits"]:
            self._guards[pid] = Guard(pid, request["limits"])
        self.tell(event="started", pid=pid, cannot=cannot)
        self.reap()  # a forked one may have ended before it was known

    def execute(self, request: dict[str, Any]) -> int:
        """Execute a component; its standard input, if it has a `script`, ends when it or this process does."""
        with contextlib.ExitStack() as files, contextlib.ExitStack() as undo:
            stdin = subprocess.DEVNULL
            if request["script"] is not None:
                stdin, held = os.pipe()
                files.callback(os.close, stdin)
                undo.callback(os.close, held)
                script = os.fsencode(request["script"])
                if len(script) > fcntl.fcntl(held, fcntl.F_GETPIPE_SZ):  # nobody reads yet, so all of it has to fit
                    fcntl.fcntl(held, fcntl.F_SETPIPE_SZ, len(script))
                os.write(held, script)
            out, err = (files.enter_context(open(request[name], "ab")) for name in ("stdout", "stderr"))
            process = subprocess.Popen(
                request["argv"],
                env=request["env"],
                cwd=request["cwd"],
                stdin=stdin,
                stdout=None if request["ours"] else out,
                stderr=None if request["ours"] else err,
                start_new_session=True,
                preexec_fn=become_fixed_component if request["fixed"] else become_component,
            )
            process.returncode = 0  # it is reaped here, by its number
            self._held[process.pid] = undo.pop_all()
        return process.pid

    def fork(self, request: dict[str, Any]) -> tuple[int, str]:
        """Fork a component from a server; return its number, or 0 and why that cannot be done."""
        fork = request["fork"]
        number = fork["server"]
        if "wanted" in fork:
            self._wanted[number] = fork["wanted"]
        server = self._servers.get(number)
        if server is None:
            server = self._servers[number] = ForkServer(self._wanted[number], fixed=request["fixed"])
        for name in ("stdout", "stderr"):
            open(request[name], "ab").close()  # they are there as soon as it is
        told = {name: request[name] for name in ("env", "cwd", "stdout", "stderr")}
        main = [] if fork["module"] is None else ["-m", fork["module"]]
        told["argv"] = [*self._wanted[number]["interpreter"], *main, *fork["words"]]
        return server.start(**told, module=fork["module"], words=fork["words"]), server.cannot

    def reap(self) -> None:
        """Report what has happened to processes: components' ends, with exit status (negative: signal) and stack."""
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG | WALL))[0]:
                pid, status = found
                if os.WIFSTOPPED(status):
                    self._tracer.let_go_on(pid, status)
                    continue
                stack, code = self._tracer.stack(pid), os.waitstatus_to_exitcode(status)
                if pid in self._running:
                    self._running.remove(pid)
                    self._guards.pop(pid, None)
                    if pid in self._held:
                        self._held.pop(pid).close()
                    self.tell(event="exited", pid=pid, status=code, stack=stack, excess=self._excess.pop(pid, None))
                    if (request := self._teardowns.pop(pid, None)) and (code or not request["undoes"]):
                        self.tear_down(pid, request)
                elif pid in self._ending:
                    self.tell(event="torn down", pid=self._ending.pop(pid), problem=f"status {code}" if code else "")

    def tear_down(self, pid: int, request: dict[str, Any]) -> None:
        """Begin what is to be done when a component has ended."""
        try:
            with open(request["teardown_output"], "ab") as out:
                process = subprocess.Popen(
                    request["teardown"],
                    env=request["env"],
                    cwd=request["cwd"],
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                    preexec_fn=become_component,
                )
        except (OSError, subprocess.SubprocessError) as error:
            self.tell(event="torn down", pid=pid, problem=str(error))
            return
        process.returncode = 0  # as above
        self._ending[process.pid] = pid

    def guard(self) -> None:
        """Kill each component that exceeds its limits, with all its descendants."""
        started = {*self._running, *self._ending, *(server.pid for server in self._servers.values())}
        for pid, guard in self._guards.items():
            orphans = set(children_of(os.getpid())) - started if len(self._running) == 1 else ()
            if pid not in self._excess and (excess := guard.excess(list(orphans))):
                self._excess[pid] = excess
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)
                for each in guard.pids():
                    with contextlib.suppress(ProcessLookupError, PermissionError):
                        os.kill(each, signal.SIGKILL)

    def kill_all(self) -> None:
        """Kill every component and all their descendants, and wait until they are gone and torn down."""
        for pid in self._running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
        deadline = time.monotonic() + self._torn_down_within
        while (self._ending or self._teardowns) and time.monotonic() < deadline:
            self.reap()
            time.sleep(0.005)  # short against the time in which an engine removes a container, up to a second
        servers = {server.pid for server in self._servers.values()}
        while children := set(children_of(os.getpid())) - servers:
            for pid in children:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(-1, WALL)  # of a traced process, each thread
                while os.waitpid(-1, WALL | os.WNOHANG)[0]:
                    pass
        for held in self._held.values():
            held.close()
        for kept in (self._running, self._guards, self._excess, self._held, self._teardowns, self._ending):
            kept.clear()

    def close(self) -> None:
        """Kill everything, servers included."""
        self.kill_all()
        for server in self._servers.values():
            server.close()

    def handle(self, request: dict[str, Any]) -> None:
        """Carry out one request."""
        match request["do"]:
            case "start":
                self.start(request)
            case "signal":
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(request["pid"], request["signal"])
            case "include":
                if request["pid"] in self._guards:
                    self._guards[request["pid"]].include(request["pids"])
            case "watch":
                self.tell(event="watched", cannot=self._tracer.watch(request["pids"]))
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
        pending, look_at = b"", math.inf
        while True:
            if not self._guards:
                look_at = math.inf
            elif look_at == math.inf:
                look_at = time.monotonic() + LOOK_S
            wait = None if look_at == math.inf else max(0.0, look_at - time.monotonic())
            readable, _, _ = select.select([self._link.fileno(), wake_read], [], [], wait)
            if time.monotonic() >= look_at:  # whatever else there is: a component's signals may never end
                self.guard()
                look_at = time.monotonic() + LOOK_S
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
    """Serve the socket on file descriptor 0 until it ends; then remove the folders that the arguments name."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    _prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER
    supervisor = Supervisor(socket.socket(fileno=0))
    try:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            supervisor.serve()
    finally:
        supervisor.close()
        if sys.argv[1:]:
            import shutil  # few need it, and all wait for imports

            for folder in sys.argv[1:]:
                shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
