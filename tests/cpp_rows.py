"""Compiles headers with sanitising functions into one program that judges rows of values."""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from riot_bus.generalize.forms.words import identifiers
from tests.rule_rows import TYPES

FLAGS = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-O0", "-ffp-contract=off")
CODES = {
    "int8": "b", "int16": "h", "int32": "i", "int64": "q", "uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q",
    "float32": "f", "float64": "d", "bool": "?",
}  # fmt: skip
_MAIN = """
#include <cstdio>
#include <cstring>
#include <iostream>
#include <iterator>

using Data = std::string;

template <class T>
void take(const char*& at, T& value) {
  std::memcpy(&value, at, sizeof value);
  at += sizeof value;
}
void take(const char*& at, Data& value) {
  std::uint32_t size = 0;
  take(at, size);
  value.assign(at, size);
  at += size;
}
template <class T>
void put(Data& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
void put(Data& out, const Data& value) {
  put(out, std::uint32_t(value.size()));
  out += value;
}

int main(int count, char**) {
  std::ios::sync_with_stdio(false);
  const Data given((std::istreambuf_iterator<char>(std::cin)), std::istreambuf_iterator<char>());
  const char* at = given.data();
  Data out;
  while (at != given.data() + given.size()) {
    ROW
    CALLS
  }
  std::cout.write(out.data(), std::streamsize(out.size()));
  (void)count;
}
"""


def needs_compiler() -> None:
    """Skip where there is no C++ compiler."""
    if shutil.which("g++") is None:
        pytest.skip("NOT TESTED: generated C++: there is no g++")


def packed(table: Sequence[Sequence[Any]]) -> bytes:
    """Return rows as the program reads them."""
    parts = []
    for row in table:
        for kind, value in zip(TYPES.values(), row, strict=True):
            if kind in CODES:
                parts.append(struct.pack("<" + CODES[kind], value))
            else:
                data = value.encode() if isinstance(value, str) else value
                parts.append(struct.pack("<I", len(data)) + data)
    return b"".join(parts)


def program(folder: Path, headers: Mapping[str, tuple[str, Sequence[str], bool]]) -> Path:
    """Compile headers (by namespace: text, names of the variables, whether it sanitises); warnings are errors.

    For each row and namespace the program writes how many terms hold and, where it sanitises, whether there are values
    for which none does, and these.
    """
    row = identifiers(list(TYPES))
    calls = []
    for space, (text, names, sanitises) in headers.items():
        (folder / f"{space}.hpp").write_text(text)
        words = identifiers(names)
        sets = " ".join(f"v.{words[name]} = {row[name]};" for name in names)
        after = ""
        if sanitises:
            puts = " ".join(f"put(out, s->{words[name]});" for name in names)
            after = f"const auto s = {space}::sanitize(v); put(out, s.has_value()); if (s) {{ {puts} }}"
        calls.append(f"{{ {space}::Input v; {sets} put(out, std::uint8_t({space}::detail::terms_met(v))); {after} }}")
    kinds = {"string": "Data", "bytes": "Data", "float32": "float", "float64": "double", "bool": "bool"}
    takes = [
        f"{kinds.get(kind, f'std::{kind}_t')} {row[name]}{{}}; take(at, {row[name]});" for name, kind in TYPES.items()
    ]
    includes = "".join(f'#include "{space}.hpp"\n' for space in headers)
    main = includes + _MAIN.replace("ROW", "\n    ".join(takes)).replace("CALLS", "\n    ".join(calls))
    (folder / "main.cpp").write_text(main)
    done = subprocess.run(
        ["g++", *FLAGS, "-o", "judge", "main.cpp"], cwd=folder, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr[:4000]
    return folder / "judge"


class Output:
    """What the program has written."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, code: str) -> Any:
        size = struct.calcsize("<" + code)
        self._at += size
        return struct.unpack("<" + code, self._data[self._at - size : self._at])[0]

    def value(self, kind: str) -> Any:
        if kind in CODES:
            return self.take(CODES[kind])
        size = self.take("I")
        self._at += size
        data = self._data[self._at - size : self._at]
        return data.decode() if kind == "string" else data

    @property
    def left(self) -> int:
        return len(self._data) - self._at
