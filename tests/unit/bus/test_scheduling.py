from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "SCHED_BATCH"), reason="this is not Linux")

SCRIPT = """
import os
import sys
import time
from pathlib import Path

os.sched_setscheduler(0, int(sys.argv[1]), os.sched_param(0))

from riot_bus.bus.client import open_client
from riot_bus.bus.scheduling import LoadScheduling
from riot_bus.bus.segments import Segment


def policies():
    zenohs, others = set(), set()
    for task in Path("/proc/self/task").iterdir():
        kind = zenohs if (task / "comm").read_text().startswith(("rx-", "tx-")) else others
        kind.add(os.sched_getscheduler(int(task.name)))
    return sorted(zenohs), sorted(others)


def until(batched, do):
    deadline = time.monotonic() + 10
    while schedule.batched != batched and time.monotonic() < deadline:
        schedule()
        do()
    return policies()


segment = Segment("a")
with open_client(segment.endpoints[0]):
    schedule = LoadScheduling()
    found = [policies()]
    if sys.argv[2] == "looks":
        found += [until(True, int), until(False, lambda: time.sleep(0.2))]
    else:
        schedule.batch()
        found.append(policies())
        schedule.release()
        found.append(policies())
    print(found)
segment.close()
"""


def policies(own: int, how: str) -> str:
    """Return those of Zenoh's threads and of all others, when the process is calm, busy and calm again."""
    command = [sys.executable, "-c", SCRIPT, str(own), how]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.strip()


def test_zenohs_threads_wait_for_their_turn_while_the_process_is_busy() -> None:
    other, batch = os.SCHED_OTHER, os.SCHED_BATCH
    calm, busy = ([other], [other]), ([batch], [other])
    assert policies(other, "looks") == str([calm, busy, calm])


def test_a_process_with_a_policy_of_its_own_keeps_it() -> None:
    batch = [os.SCHED_BATCH]
    assert policies(os.SCHED_BATCH, "told") == str([(batch, batch)] * 3)
