"""ELF files, as far as native stacks need them: names of functions, and unwinding from a function to its caller.

Unwinding uses call frame information (`.eh_frame`, as in the DWARF standard and the Linux Standard Base), which
compilers write for exceptions with or without frame pointers. Only the standard library is used, as this runs in the
supervisor.
"""

from __future__ import annotations

import os
import re
import struct
from array import array
from bisect import bisect_right
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

Symbols = IntEnum("Symbols", {"ALL": 2, "DYNAMIC": 11})
"""Kinds of symbol tables: SHT_SYMTAB and SHT_DYNSYM."""
_Segment = IntEnum("_Segment", {"LOAD": 1, "EH_FRAME": 0x6474E550})
_SEARCH_TABLE = b"\x01\x1b\x03\x3b"  # version 1; what all linkers write
_KINDS = {0: "Q", 2: "H", 3: "I", 4: "Q", 10: "h", 11: "i", 12: "q"}
_CLONE = re.compile(r"(\.(cold|part|isra|constprop|lto_priv|llvm)(\.\d+)*)+$|17h[0-9a-f]{16}(?=E$)")
"""Suffixes that compilers add to names of parts and copies of functions, and the hash that Rust adds to all names."""


class CallFrame(NamedTuple):
    """How to unwind from a place in a function to its caller.

    Attributes:
        register: Register whose value plus `offset` is the caller's stack pointer.
        saved: Offsets of saved registers from that stack pointer; None for registers whose value is lost.
        return_register: Number of the register that holds the return address, or as which it is saved.
        signal: Whether signal handlers return to this place; then there is no information about registers.
    """

    begin: int
    register: int
    offset: int
    saved: dict[int, int | None]
    return_register: int
    signal: bool = False


@dataclass(slots=True)
class _Reader:
    """Reads the encodings of call frame information."""

    data: bytes
    at: int = 0

    def number(self, kind: str) -> int:
        found = struct.unpack_from(f"<{kind}", self.data, self.at)[0]
        self.at += struct.calcsize(f"<{kind}")
        return int(found)

    def unsigned(self) -> int:
        found = shift = 0
        while True:
            byte = self.number("B")
            found |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return found

    def signed(self) -> int:
        begin, found = self.at, self.unsigned()
        bits = 7 * (self.at - begin)
        return found - (1 << bits) if found >> (bits - 1) else found

    def pointer(self, encoding: int, here: int) -> int:
        """Read a pointer; `here` is the address at which the data begins."""
        base = here + self.at if encoding & 0x70 == 0x10 else 0
        return base + self.number(_KINDS[encoding & 0x0F])


@dataclass(slots=True)
class _Rows:
    """Executes call frame instructions up to a place in a function."""

    code: int
    data: int
    left: int
    cfa: tuple[int, int] | None = None
    saved: dict[int, int | None] = field(default_factory=dict)
    initial: dict[int, int | None] = field(default_factory=dict)
    kept: list[tuple[tuple[int, int] | None, dict[int, int | None]]] = field(default_factory=list)

    def run(self, reader: _Reader, *, initial: bool = False) -> None:
        while reader.at < len(reader.data) and self.left >= 0:
            byte = reader.number("B")
            high, low = byte & 0xC0, byte & 0x3F
            if high == 0x40:
                self.left -= low * self.code
            elif high == 0x80:
                self.saved[low] = reader.unsigned() * self.data
            elif high == 0xC0:
                self._restore(low)
            else:
                self._extended(low, reader)
        if initial:
            self.initial = dict(self.saved)

    def _restore(self, register: int) -> None:
        self.saved.pop(register, None)
        if register in self.initial:
            self.saved[register] = self.initial[register]

    def _extended(self, operation: int, reader: _Reader) -> None:
        match operation:
            case 0x02 | 0x03 | 0x04:  # advance the location
                self.left -= reader.number("BHI"[operation - 2]) * self.code
            case 0x05 | 0x11:  # a register is saved
                register = reader.unsigned()
                self.saved[register] = (reader.signed() if operation == 0x11 else reader.unsigned()) * self.data
            case 0x06:
                self._restore(reader.unsigned())
            case 0x07:  # a register's value in the caller is lost
                self.saved[reader.unsigned()] = None
            case 0x08:  # a register has the same value in the caller
                self.saved.pop(reader.unsigned(), None)
            case 0x0A:
                self.kept.append((self.cfa, dict(self.saved)))
            case 0x0B:
                self.cfa, self.saved = self.kept.pop()
            case 0x0C | 0x12:
                register = reader.unsigned()
                self.cfa = register, reader.signed() * self.data if operation == 0x12 else reader.unsigned()
            case 0x0D:
                self.cfa = reader.unsigned(), self.cfa[1] if self.cfa else 0
            case 0x0E | 0x13:
                offset = reader.signed() * self.data if operation == 0x13 else reader.unsigned()
                self.cfa = self.cfa[0] if self.cfa else 0, offset
            case 0x0F:  # an expression
                reader.at += reader.unsigned()
                self.cfa = None
            case 0x10 | 0x16:
                self.saved[reader.unsigned()] = None
                reader.at += reader.unsigned()
            case 0x2E:
                reader.unsigned()
            case 0x00 | 0x2D:  # nothing; the return address is authenticated from here on
                pass
            case _:
                raise ValueError(f"call frame instruction {operation:#x}")


class ElfFile:
    """A 64-bit little-endian ELF file, as far as native stacks need it."""

    def __init__(self, path: str) -> None:
        self._path = path
        header = self._read(0, 64)
        if header[:6] != b"\x7fELF\x02\x01":
            raise ValueError(f"{path} is not a 64-bit little-endian ELF file")
        segments, self._sections, _, _, size, count, *sections = struct.unpack("<QQIHHHHHH", header[32:])
        self._section_size, self._section_count = sections[:2]
        fields = struct.iter_unpack("<IIQQQQQQ", self._read(segments, size * count))
        self._segments: list[tuple[int, int, int, int]] = [
            (kind, offset, address, held) for kind, _, offset, address, _, held, _, _ in fields
        ]

    def _read(self, offset: int, size: int) -> bytes:
        with open(self._path, "rb", buffering=0) as stream:
            return os.pread(stream.fileno(), min(size, 64 << 20), offset)

    def address(self, offset: int) -> int:
        """Return the address in the file's address space of a position in the file."""
        for kind, begin, address, size in self._segments:
            if kind == _Segment.LOAD and begin <= offset < begin + size:
                return offset - begin + address
        raise ValueError(f"nothing is loaded from position {offset}")

    def _loaded(self, address: int, size: int) -> bytes:
        for kind, offset, begin, held in self._segments:
            if kind == _Segment.LOAD and begin <= address < begin + held:
                return self._read(offset + address - begin, min(size, begin + held - address))
        raise ValueError(f"nothing is loaded at address {address}")

    def _record(self, address: int) -> _Reader:
        """Return a record of call frame information, positioned after its length."""
        return _Reader(self._loaded(address, 4 + struct.unpack("<I", self._loaded(address, 4))[0]), 4)

    def tables(self, kind: Symbols) -> list[tuple[bytes, bytes]]:
        """Return the symbol tables of a kind, each with its names."""
        raw = self._read(self._sections, self._section_size * self._section_count)
        sections = list(struct.iter_unpack("<IIQQQQIIQQ", raw))
        found = []
        for section in sections:
            if section[1] == kind:
                names = sections[section[6]]
                found.append((self._read(section[4], section[5]), self._read(names[4], names[5])))
        return found

    @cached_property
    def _functions(self) -> list[tuple[int, int, str]]:
        """Start address, size and name of all functions, sorted."""
        found = []
        for table, names in self.tables(Symbols.ALL) or self.tables(Symbols.DYNAMIC):
            for name, info, _, section, value, size in struct.iter_unpack("<IBBHQQ", table):
                if section and info & 0xF in (2, 10):  # STT_FUNC, STT_GNU_IFUNC
                    found.append((value, size, names[name : names.find(b"\0", name)].decode(errors="replace")))
        return sorted(found)

    def function(self, address: int) -> str:
        """Return the name of the function at an address, or `+` and its start address if it has no name."""
        at = bisect_right(self._functions, (address, 1 << 64, ""))
        for begin, size, name in reversed(self._functions[max(0, at - 8) : at]):
            if begin <= address < begin + max(size, 1):
                return _CLONE.sub("", name)
        frame = self.call_frame(address)
        return f"+{frame.begin if frame else address:#x}"

    @cached_property
    def _search_table(self) -> tuple[int, array[int], array[int]]:
        """Address of the table of call frame information, and relative addresses of functions and their entries."""
        numbers = array("i")
        for kind, offset, address, size in self._segments:
            if kind == _Segment.EH_FRAME:
                data = self._read(offset, size)
                if data[:4] == _SEARCH_TABLE:
                    numbers.frombytes(data[12 : 12 + 8 * struct.unpack_from("<I", data, 8)[0]])
                    return address, numbers[::2], numbers[1::2]
        return 0, numbers, numbers

    def call_frame(self, address: int) -> CallFrame | None:
        """Return how to unwind from an address to the caller; None if that is not known."""
        base, begins, entries = self._search_table
        at = bisect_right(begins, address - base) - 1
        if at < 0:
            return None
        here = base + entries[at]
        entry = self._record(here)
        common = self._record(here + 4 - entry.number("I"))
        common.at += 4
        version = common.number("B")
        augmentation = common.data[common.at : common.data.index(b"\0", common.at)].decode()
        common.at += len(augmentation) + 1
        code, data = common.unsigned(), common.signed()
        return_register = common.number("B") if version == 1 else common.unsigned()
        encoding = 0
        if augmentation[:1] == "z":
            end = common.unsigned() + common.at
            for letter in augmentation[1:]:
                if letter == "R":
                    encoding = common.number("B")
                elif letter == "P":
                    common.pointer(common.number("B") & 0x0F, 0)
                elif letter == "L":
                    common.at += 1
            common.at = end
        begin = entry.pointer(encoding, here)
        if not begin <= address < begin + entry.pointer(encoding & 0x0F, here):
            return None
        if "S" in augmentation:
            return CallFrame(begin, 0, 0, {}, return_register, signal=True)
        if augmentation[:1] == "z":
            entry.at += entry.unsigned()
        rows = _Rows(code, data, address - begin)
        rows.run(common, initial=True)
        rows.run(entry)
        if rows.cfa is None:
            return None
        return CallFrame(begin, *rows.cfa, rows.saved, return_register)
