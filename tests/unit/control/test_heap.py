from __future__ import annotations

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.control.heap import trim_heap

pytestmark = pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="this is not glibc")

BURST = """
from pathlib import Path
from riot_bus.control.heap import steady_heap

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

steady_heap()
bytearray(16_000_000)  # freed at once, after which glibc would keep blocks of this size by itself
before, kept = resident(), []
parts = []
for _ in range(1000):
    parts.append(bytearray(b"x" * 200_000))
    kept.append(bytearray(b"x" * 1000))
parts.clear()
print(resident() - before)
"""


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def burst(**environment: str) -> int:
    """Return by how much a process is larger after it had and let go of 200 MB."""
    done = subprocess.run(
        [sys.executable, "-c", BURST], env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    return int(done.stdout)


def test_freed_memory_goes_back_though_something_behind_it_is_in_use() -> None:
    kept = []
    parts = [bytes(60_000) for _ in range(2000)]
    kept.append(bytes(60_000))
    before = resident()
    parts.clear()
    trim_heap()
    assert before - resident() > 60_000_000
    assert kept


def test_a_burst_leaves_nothing_behind() -> None:
    assert burst() < 5_000_000


def test_what_users_wish_of_the_heap_is_kept() -> None:
    assert burst(MALLOC_MMAP_THRESHOLD_="33554432", MALLOC_TRIM_THRESHOLD_="1073741824") > 100_000_000


def test_the_collector_leaves_alone_what_is_there() -> None:
    script = "import gc\nfrom riot_bus.control.heap import calm_collector\nkept = [[] for _ in range(1000)]\n"
    script += "calm_collector()\nprint(len(gc.get_objects()), gc.get_freeze_count() > 1000, gc.isenabled())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    seen, frozen, enabled = done.stdout.split()
    assert (int(seen) < 1000, frozen, enabled) == (True, "True", "True")
