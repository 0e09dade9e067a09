from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.control import memory
from riot_bus.control.memory import check_memory, memory_limit, resident_bytes
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError


def test_what_is_used_is_known() -> None:
    before = resident_bytes()
    block = bytearray(64 << 20)
    block[:: memory._PAGE] = b"x" * len(block[:: memory._PAGE])
    assert resident_bytes() - before > 60 << 20


def test_the_limit_is_a_share_of_what_there_is_or_what_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(memory, "_GROUP", group := tmp_path / "memory.max")
    whole = memory_limit()
    assert whole > 0
    group.write_text("max\n")
    assert memory_limit() == whole
    group.write_text(f"{100 << 20}\n")
    assert memory_limit() == 75 << 20
    monkeypatch.setenv("RIOT_MEMORY_LIMIT", "2GiB")
    assert memory_limit() == 2 << 30
    monkeypatch.setenv("RIOT_MEMORY_LIMIT", "much")
    with pytest.raises(ConfigError, match="RIOT_MEMORY_LIMIT: 'much' is not a size"):
        memory_limit()


def test_too_much_is_an_error_and_the_end_is_near() -> None:
    check_memory(1 << 50)
    code = """
from riot_bus.control import memory
memory._END_S = 0.3
try:
    memory.check_memory(1)
except memory.EnvironmentFaultError as error:
    print(error, flush=True)
while True:
    pass
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "MiB of memory, more than 0 MiB" in done.stdout
    assert "RIOT_MEMORY_LIMIT" in done.stdout
    assert EnvironmentFaultError.exit_code == 4
