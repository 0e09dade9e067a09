"""What is read of a component's output; starting and ending: test_processes.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.sut import launcher
from riot_bus.sut.launcher import ComponentProcess


def process(folder: Path, *, stdout: bytes = b"", stderr: bytes = b"") -> ComponentProcess:
    out, err = folder / "part.out", folder / "part.err"
    out.write_bytes(stdout)
    err.write_bytes(stderr)
    return ComponentProcess("part", 1, out, err)


def test_early_output_is_read_however_much_comes_after_it(tmp_path: Path) -> None:
    one = process(tmp_path, stdout=b"first\n" + bytes(1 << 20), stderr=b"Traceback\n" + b"." * (1 << 20))
    assert one.printed().startswith("first\n")
    assert one.errors().startswith("Traceback\n")
    assert one.unread == 0


def test_of_too_much_the_begin_and_the_end_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launcher, "_HALF", 4)
    one = process(tmp_path, stdout=b"12345678", stderr=b"1234abc5678")
    assert (one.printed(), one.errors()) == ("12345678", "1234\n5678")
    assert one.unread == 3
