from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from riot_bus.bus.heap import trim_heap


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="this is not glibc")
def test_freed_memory_goes_back_though_something_behind_it_is_in_use() -> None:
    kept = []
    parts = [bytes(60_000) for _ in range(2000)]
    kept.append(bytes(60_000))
    before = resident()
    parts.clear()
    trim_heap()
    assert before - resident() > 60_000_000
    assert kept
