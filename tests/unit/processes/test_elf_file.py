"""Functions and call frames of an ELF file, of a library that is built here."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from riot_bus.processes.elf_file import ElfFile, Symbols

SOURCE = """
static int __attribute__((noinline)) hidden(volatile int *at) { return *at + 1; }
int shown(volatile int *at) { volatile int room[64]; room[0] = hidden(at); return room[0] + 1; }
__asm__(".globl named.constprop.0\\n.type named.constprop.0, @function\\n"
        "named.constprop.0: nop\\n.size named.constprop.0, 1\\n");
__asm__(".globl _ZN4core3fmt17h0123456789abcdefE\\n.type _ZN4core3fmt17h0123456789abcdefE, @function\\n"
        "_ZN4core3fmt17h0123456789abcdefE: nop\\n.size _ZN4core3fmt17h0123456789abcdefE, 1\\n");
"""


@pytest.fixture
def library(tmp_path: Path) -> Path:
    if shutil.which("cc") is None:
        pytest.skip("NOT TESTED: native stacks: there is no C compiler")
    path = tmp_path / "library.so"
    command = ["cc", "-O1", "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)]
    subprocess.run(command, input=SOURCE, text=True, check=True)
    return path


def places(library: Path) -> dict[str, int]:
    """Return where functions begin, as binutils say it."""
    lines = subprocess.run(["nm", str(library)], capture_output=True, text=True, check=True).stdout.splitlines()
    return {parts[2]: int(parts[0], 16) for parts in map(str.split, lines) if len(parts) == 3}


def test_functions_are_named_without_what_compilers_add(library: Path) -> None:
    file, known = ElfFile(str(library)), places(library)
    assert file.function(known["shown"] + 3) == "shown"
    assert file.function(known["hidden"]) == "hidden"
    assert file.function(known["named.constprop.0"]) == "named"
    assert file.function(known["_ZN4core3fmt17h0123456789abcdefE"]) == "_ZN4core3fmtE"


def test_functions_without_a_symbol_are_told_by_where_they_begin(library: Path) -> None:
    known = places(library)
    subprocess.run(["strip", str(library)], check=True)
    file = ElfFile(str(library))
    assert file.function(known["hidden"] + 2) == f"+{known['hidden']:#x}"
    assert file.function(known["shown"] + 2) == "shown"


def test_the_way_to_the_caller_is_known_at_each_place(library: Path) -> None:
    file, known = ElfFile(str(library)), places(library)
    first, later = file.call_frame(known["shown"]), file.call_frame(known["shown"] + 12)
    assert first is not None
    assert later is not None
    assert first.begin == later.begin == known["shown"]
    assert later.offset - first.offset >= 64 * 4
    assert file.call_frame(0) is None


def test_names_that_a_program_imports_are_in_a_table(library: Path) -> None:
    assert any(b"shown" in names for _, names in ElfFile(str(library)).tables(Symbols.DYNAMIC))


def test_what_is_no_elf_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_text("#!/bin/sh\n")
    with pytest.raises(ValueError, match="not a 64-bit"):
        ElfFile(str(path))
