from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "SCHED_BATCH"), reason="this is not Linux")

SCRIPT = """
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

os.sched_setscheduler(0, int(sys.argv[1]), os.sched_param(0))

from riot_bus.zenoh.client import open_client
from riot_bus.control.scheduling import LoadScheduling
from riot_bus.zenoh.segments import Segment


def names():
    found = {}
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # it has ended
            found[int(task.name)] = (task / "comm").read_text()
    return found


def policies():
    found = {}
    for thread, name in names().items():
        with suppress(OSError):
            found[thread] = name.startswith(("rx-", "tx-")), os.sched_getscheduler(thread)
    return found


def until(batched):
    while schedule.batched != batched:
        schedule()
        time.sleep(0.05)
    return policies()


segment = Segment("a")
with open_client(segment.endpoints[0]):
    used = time.monotonic  # as busy as one processor can be, whatever else this machine does
    schedule = LoadScheduling(lambda: used())
    while list(names().values()).count(names()[os.getpid()]) > threading.active_count():
        time.sleep(0.01)  # a thread gives itself its name when it first runs
    found = [policies()]
    if sys.argv[2] == "looks":
        found.append(until(True))
        used = time.process_time
        found.append(until(False))
    else:
        schedule.batch()
        found.append(policies())
        schedule.release()
        found.append(policies())
    always = set.intersection(*map(set, found))  # others have come or gone
    kinds = [(each, zenohs) for each in found for zenohs in (True, False)]
    print([sorted({each[one][1] for one in always if each[one][0] == zenohs}) for each, zenohs in kinds])
segment.close()
"""


def policies(own: int, how: str) -> str:
    """Return those of Zenoh's threads and of all others, when the process is calm, busy and calm again."""
    command = [sys.executable, "-c", SCRIPT, str(own), how]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.strip()


def test_zenohs_threads_wait_for_their_turn_while_the_process_is_busy() -> None:
    other, batch = os.SCHED_OTHER, os.SCHED_BATCH
    calm, busy = [[other], [other]], [[batch], [other]]  # Zenoh's, others
    assert policies(other, "looks") == str([*calm, *busy, *calm])


def test_a_process_with_a_policy_of_its_own_keeps_it() -> None:
    batch = [os.SCHED_BATCH]
    assert policies(os.SCHED_BATCH, "told") == str([batch] * 6)
