from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.log.engine import umask
from riot_bus.log.engine.umask import new_file_mode


def test_files_have_the_mode_of_any_new_file(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.touch()
    assert new_file_mode() == other.stat().st_mode & 0o777


@pytest.mark.parametrize("status", ["/proc/self/status", "/nonexistent"])
def test_it_is_what_the_umask_leaves(status: str) -> None:
    code = f"""
import os, pathlib
from riot_bus.log.engine import umask
umask._STATUS = pathlib.Path({status!r})
os.umask(0o027)
print(oct(umask.new_file_mode()), oct(os.umask(0)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "0o640 0o27\n"
    assert umask.__all__ == ["new_file_mode"]
