"""Finds where a signal kills a component: stops it just before, by ptrace, and reads its native stack.

It belongs to the supervisor (standard library only, one thread), which waits for all processes that it starts and so
is notified of each stop. A component is watched from the moment that it is ready, so its start is not slowed down.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
from contextlib import suppress

from riot_bus.processes.elf_file import SHT_DYNSYM, ElfFile
from riot_bus.processes.native_stack import AARCH64, UNREADABLE, X86_64, unwind

WALL = 0x40000000
"""Option of `os.waitpid` that includes traced threads."""

_CONT, _GETREGSET, _SEIZE, _LISTEN = 7, 0x4204, 0x4206, 0x4208
_TRACE_CLONE, _EXIT_KILL = 1 << 3, 1 << 20
_EVENT_STOP = 128
_PRSTATUS = 1
_MOST_REGISTERS = 512
_MACHINES = {"x86_64": X86_64, "aarch64": AARCH64}
_FATAL = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP)
_SANITIZER = b"san_init"
"""Part of symbol names of every sanitizer. They write reports themselves, and LeakSanitizer gives up if traced."""

_ptrace = ctypes.CDLL(None, use_errno=True).ptrace
_ptrace.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
_ptrace.restype = ctypes.c_long


class _Area(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


def _request(number: int, thread: int, where: int = 0, data: int | None = 0) -> int:
    """Carry out a ptrace request; return 0 or the error number."""
    return 0 if _ptrace(number, thread, where, data) == 0 else ctypes.get_errno()


class Tracer:
    """Watches processes for signals that kill them."""

    def __init__(self) -> None:
        self._machine = _MACHINES.get(os.uname().machine)
        self._stacks: dict[int, list[tuple[str, str]]] = {}
        self._sanitized: dict[tuple[str, int], bool] = {}

    def watch(self, pids: list[int]) -> str:
        """Watch processes and those that they have started, with later threads but without later processes.

        Returns:
            Reason why that is impossible; empty on success.
        """
        if self._machine is None:
            return f"not for {os.uname().machine} processors"
        left, refused = list(pids), ""
        while left:
            try:
                left += self._watch(left.pop())
            except PermissionError as error:
                refused = str(error.strerror)
            except UNREADABLE:  # it has ended, or its file has no readable symbols
                continue
        return refused

    def _watch(self, pid: int) -> list[int]:
        """Watch a process; return its child processes."""
        seize, children, known = not self._reports_itself(pid), list[int](), set[str]()
        while new := set(os.listdir(f"/proc/{pid}/task")) - known:  # there may be more while this works
            known |= new
            for thread in new:
                error = _request(_SEIZE, int(thread), 0, _TRACE_CLONE | _EXIT_KILL) if seize else 0
                if error == errno.EPERM and b"\nTracerPid:\t0\n" in _status(int(thread)):
                    raise PermissionError(error, os.strerror(error))
                with suppress(OSError), open(f"/proc/{pid}/task/{thread}/children", "rb") as stream:
                    children += map(int, stream.read().split())
        return children

    def let_go_on(self, thread: int, status: int) -> None:
        """Resume a thread whose stop `os.waitpid` reported; if a signal is about to kill it, save its stack first."""
        number, event = os.WSTOPSIG(status), status >> 16
        if event == _EVENT_STOP and number != signal.SIGTRAP:  # it is stopped until SIGCONT
            _request(_LISTEN, thread)
            return
        if not event and number in _FATAL:
            with suppress(*UNREADABLE):
                self._look(thread, number)
        _request(_CONT, thread, 0, 0 if event else number)

    def stack(self, pid: int) -> list[tuple[str, str]]:
        """Return the stack at which a signal killed a process, and forget it; empty if unknown."""
        return self._stacks.pop(pid, [])

    def _look(self, thread: int, number: int) -> None:
        text = _status(thread)
        if int(text.partition(b"\nSigCgt:\t")[2].split()[0], 16) >> (number - 1) & 1:  # it has a handler for it
            return
        pid = int(text.partition(b"\nTgid:\t")[2].split()[0])
        buffer = ctypes.create_string_buffer(_MOST_REGISTERS)
        area = _Area(ctypes.addressof(buffer), len(buffer))
        if self._machine and not _request(_GETREGSET, thread, _PRSTATUS, ctypes.addressof(area)):
            self._stacks[pid] = unwind(pid, buffer.raw[: area.size], self._machine)

    def _reports_itself(self, pid: int) -> bool:
        """Return whether a process was started with a sanitizer, linked in or preloaded."""
        with open(f"/proc/{pid}/environ", "rb") as stream:
            preloaded = stream.read().partition(b"LD_PRELOAD=")[2].partition(b"\0")[0]
        path = os.readlink(f"/proc/{pid}/exe")
        key = path, os.stat(path).st_mtime_ns
        if key not in self._sanitized:
            self._sanitized[key] = any(_SANITIZER in names for _, names in ElfFile(path).tables(SHT_DYNSYM))
        return self._sanitized[key] or b"san.so" in preloaded


def _status(thread: int) -> bytes:
    with open(f"/proc/{thread}/status", "rb") as stream:
        return stream.read()
