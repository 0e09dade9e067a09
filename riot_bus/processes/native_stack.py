"""The native stack of a stopped thread: functions and their files, from /proc and ELF files.

Only the standard library is used, as this runs in the supervisor.
"""

from __future__ import annotations

import os
import struct
from contextlib import suppress
from typing import NamedTuple

from riot_bus.processes.elf_file import CallFrame, ElfFile

UNREADABLE = (OSError, ValueError, LookupError, ArithmeticError, struct.error)
"""Exceptions caused by memory or files that are unreadable or malformed."""


class Machine(NamedTuple):
    """Registers of an architecture, by their DWARF numbers.

    Attributes:
        order: Numbers in the order in which the kernel gives the registers (`NT_PRSTATUS`); -1 for unused ones.
        pc: Number for the program counter.
        sp: Number of the stack pointer.
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


class _Mapping(NamedTuple):
    start: int
    end: int
    offset: int
    path: str


_files: dict[tuple[str, int, int], ElfFile | None] = {}


def unwind(pid: int, registers: bytes, machine: Machine) -> list[tuple[str, str]]:
    """Return the stack of a stopped thread: file and function of each frame, the innermost first.

    A function without a name is denoted by `+` and its offset in the file, which is the same in each process.

    Args:
        pid: Id of the thread's process.
        registers: Registers as the kernel gives them (`NT_PRSTATUS`).
        machine: Architecture of the registers.

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
