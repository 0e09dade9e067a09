"""Finds where a signal kills a component: stops it just before, by ptrace, and reads its native stack.

It belongs to the supervisor (standard library only, one thread), which waits for all processes that it starts and so
is notified of each stop. A component is watched from the moment that it is ready, so its start is not slowed down.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import struct
from contextlib import suppress
from enum import IntEnum, IntFlag
from typing import NamedTuple

from riot_bus.processes.elf_file import CallFrame, ElfFile, Symbols

WALL = 0x40000000
"""Option of `os.waitpid` that includes traced threads."""

_Call = IntEnum("_Call", {"CONT": 7, "GETREGSET": 0x4204, "SEIZE": 0x4206, "LISTEN": 0x4208})
_Option = IntFlag("_Option", {"TRACE_CLONE": 1 << 3, "EXIT_KILL": 1 << 20})
_FATAL = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP)
_SANITIZER = b"san_init"
"""Part of symbol names of every sanitizer. They write reports themselves, and LeakSanitizer gives up if traced."""

_ptrace = ctypes.CDLL(None, use_errno=True).ptrace
_ptrace.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
_ptrace.restype = ctypes.c_long


UNREADABLE = (OSError, ValueError, LookupError, ArithmeticError, struct.error)
"""Exceptions caused by memory or files that are unreadable or malformed."""


class Machine(NamedTuple):
    """Registers of an architecture, by their DWARF numbers.

    Attributes:
        order: Numbers in the order in which the kernel gives the registers (`NT_PRSTATUS`); -1 for unused ones.
        link: Number of the register with the return address of functions without a frame; None if it is on the stack.
        saved: Offset from the stack pointer of the registers that a signal handler saves, and their numbers in order.
        address: Mask of the bits of an address; the other bits authenticate it.
    """

    order: tuple[int, ...]
    pc: int
    sp: int
    link: int | None
    saved: tuple[int, tuple[int, ...]]
    address: int


X86_64 = Machine(
    order=(15, 14, 13, 12, 6, 3, 11, 10, 9, 8, 0, 2, 1, 4, 5, -1, 16, -1, -1, 7),
    pc=16,
    sp=7,
    link=None,
    saved=(40, (8, 9, 10, 11, 12, 13, 14, 15, 5, 4, 6, 3, 1, 0, 2, 7, 16)),
    address=(1 << 64) - 1,
)
AARCH64 = Machine(order=(*range(33),), pc=32, sp=31, link=30, saved=(312, (*range(33),)), address=(1 << 48) - 1)
_MACHINES = {"x86_64": X86_64, "aarch64": AARCH64}


class _Mapping(NamedTuple):
    start: int
    end: int
    offset: int
    path: str


_files: dict[tuple[str, int, int], ElfFile | None] = {}


def unwind(pid: int, registers: bytes, machine: Machine) -> list[tuple[str, str]]:
    """Return the stack of a stopped thread: file and function of each frame, the innermost first.

    A function without a name is denoted by `+` and its offset in the file, which is the same in each process.

    Raises:
        OSError: The process is gone.
    """
    words = struct.unpack(f"<{len(registers) // 8}Q", registers)
    known = {number: word for number, word in zip(machine.order, words, strict=False) if number >= 0}
    with open(f"/proc/{pid}/maps", encoding="utf-8", errors="replace") as lines:
        mappings = [mapping for line in lines if (mapping := _executable(line))]
    frames: list[tuple[str, str]] = []
    exact = True  # else it is a return address, and the call is before it
    with open(f"/proc/{pid}/mem", "rb", buffering=0) as memory, suppress(*UNREADABLE):
        while len(frames) < 64 and (known[machine.pc] or exact):  # endless recursion has thousands
            place, top = known[machine.pc] - (not exact), known[machine.sp]
            mapping = next((each for each in mappings if each.start <= place < each.end), None)
            function, frame = _look_up(mapping, place) if mapping else ("", None)
            if mapping:
                frames.append((mapping.path, function))
            if (frame and frame.signal) or (machine.link and mapping and mapping.path == "[vdso]"):
                known, exact = _interrupted(top, memory.fileno(), machine), True
                continue
            if frame is None and not exact:
                break
            known = _caller(frame, known, memory.fileno(), machine)
            if known[machine.sp] <= top and not exact:
                break
            exact = False
    return frames


def _executable(line: str) -> _Mapping | None:
    parts = line.rstrip("\n").split(maxsplit=5)
    if "x" not in parts[1]:
        return None
    start, _, end = parts[0].partition("-")
    return _Mapping(int(start, 16), int(end, 16), int(parts[2], 16), parts[5] if len(parts) > 5 else "")


def _look_up(mapping: _Mapping, place: int) -> tuple[str, CallFrame | None]:
    """Return the function at a place, and how to unwind to its caller; nothing if the place is in no file."""
    if not mapping.path.startswith("/"):
        return "", None
    offset = place - mapping.start + mapping.offset
    with suppress(*UNREADABLE):
        file = _elf_file(mapping.path)
        if file is not None:
            address = file.address(offset)
            return file.function(address), file.call_frame(address)
    return f"+{offset:#x}", None


def _elf_file(path: str) -> ElfFile | None:
    """Return a file, cached until it changes; None if it is not readable."""
    about = os.stat(path)
    key = path, about.st_mtime_ns, about.st_ino
    if key not in _files:
        if len(_files) >= 256:  # a process maps dozens; tables of files since rebuilt must not fill the memory
            _files.clear()
        _files[key] = None
        _files[key] = ElfFile(path)
    return _files[key]


def _words(memory: int, place: int, count: int) -> tuple[int, ...]:
    return struct.unpack(f"<{count}Q", os.pread(memory, 8 * count, place))


def _interrupted(top: int, memory: int, machine: Machine) -> dict[int, int]:
    """Return the registers of what a signal has interrupted."""
    offset, numbers = machine.saved
    return dict(zip(numbers, _words(memory, top + offset, len(numbers)), strict=True))


def _caller(frame: CallFrame | None, known: dict[int, int], memory: int, machine: Machine) -> dict[int, int]:
    """Return the registers of the caller; without a frame, as after a jump to nowhere, those just before the call."""
    top, caller = known[machine.sp], dict(known)
    if frame is None:
        on_stack = machine.link is None
        caller[machine.pc] = (_words(memory, top, 1)[0] if on_stack else known[machine.link or 0]) & machine.address
        caller[machine.sp] = top + 8 * on_stack
        return caller
    begin = known[frame.register] + frame.offset
    for register, offset in frame.saved.items():
        if offset is None:
            caller.pop(register, None)
        else:
            caller[register] = _words(memory, begin + offset, 1)[0]
    caller[machine.pc], caller[machine.sp] = caller[frame.return_register] & machine.address, begin
    return caller


class _Area(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


def _request(number: _Call, thread: int, where: int = 0, data: int | None = 0) -> int:
    """Carry out a ptrace request; return 0 or the error number."""
    return 0 if _ptrace(number, thread, where, data) == 0 else ctypes.get_errno()


class Tracer:
    """Watches processes for signals that kill them."""

    def __init__(self) -> None:
        self._machine = _MACHINES.get(os.uname().machine)
        self._stacks: dict[int, list[tuple[str, str]]] = {}
        self._sanitized: dict[tuple[str, int], bool] = {}

    def watch(self, pids: list[int]) -> str:
        """Watch processes and those that they started, with later threads; return why that fails, if it does."""
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
                error = _request(_Call.SEIZE, int(thread), 0, _Option.TRACE_CLONE | _Option.EXIT_KILL) if seize else 0
                if error == errno.EPERM and b"\nTracerPid:\t0\n" in _status(int(thread)):
                    raise PermissionError(error, os.strerror(error))
                with suppress(OSError), open(f"/proc/{pid}/task/{thread}/children", "rb") as stream:
                    children += map(int, stream.read().split())
        return children

    def let_go_on(self, thread: int, status: int) -> None:
        """Resume a thread whose stop `os.waitpid` reported; if a signal is about to kill it, save its stack first."""
        number, event = os.WSTOPSIG(status), status >> 16
        if event == 128 and number != signal.SIGTRAP:  # PTRACE_EVENT_STOP: it is stopped until SIGCONT
            _request(_Call.LISTEN, thread)
            return
        if not event and number in _FATAL:
            with suppress(*UNREADABLE):
                self._look(thread, number)
        _request(_Call.CONT, thread, 0, 0 if event else number)

    def stack(self, pid: int) -> list[tuple[str, str]]:
        """Return the stack at which a signal killed a process, and forget it; empty if unknown."""
        return self._stacks.pop(pid, [])

    def _look(self, thread: int, number: int) -> None:
        text = _status(thread)
        if int(text.partition(b"\nSigCgt:\t")[2].split()[0], 16) >> (number - 1) & 1:  # it has a handler for it
            return
        pid = int(text.partition(b"\nTgid:\t")[2].split()[0])
        buffer = ctypes.create_string_buffer(512)
        area = _Area(ctypes.addressof(buffer), len(buffer))
        if self._machine and not _request(_Call.GETREGSET, thread, 1, ctypes.addressof(area)):  # NT_PRSTATUS
            self._stacks[pid] = unwind(pid, buffer.raw[: area.size], self._machine)

    def _reports_itself(self, pid: int) -> bool:
        """Return whether a process was started with a sanitizer, linked in or preloaded."""
        with open(f"/proc/{pid}/environ", "rb") as stream:
            preloaded = stream.read().partition(b"LD_PRELOAD=")[2].partition(b"\0")[0]
        path = os.readlink(f"/proc/{pid}/exe")
        key = path, os.stat(path).st_mtime_ns
        if key not in self._sanitized:
            self._sanitized[key] = any(_SANITIZER in names for _, names in ElfFile(path).tables(Symbols.DYNAMIC))
        return self._sanitized[key] or b"san.so" in preloaded


def _status(thread: int) -> bytes:
    with open(f"/proc/{thread}/status", "rb") as stream:
        return stream.read()
