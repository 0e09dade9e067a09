"""When has a component finished what it was given? Measured, never slept for.

The sum of context switches of all its threads stands still, and no thread is running or waiting for a processor
(facts: a window of 15 ms came right after the last of 200 one-millisecond callbacks in 5 of 5 tries; the state of the
threads makes it hold on a loaded machine too).
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["Activity", "activity", "families", "wait_sent", "wait_settled"]

_POLL = 0.004
_ZENOH_THREADS = (b"app-", b"acc-", b"tx-", b"rx-", b"net-")


@dataclass(frozen=True, slots=True)
class Activity:
    """Context switches so far of a group of processes, and whether any of their threads wants the processor."""

    switches: int
    busy: bool


def families(pids: Sequence[int]) -> list[int]:
    """Return processes and all that they have started and still run, such as the node behind `ros2 run`."""
    import psutil

    found = list(pids)
    for pid in pids:
        with suppress(psutil.Error):
            found += [child.pid for child in psutil.Process(pid).children(recursive=True)]
    return found


def activity(pids: Sequence[int]) -> Activity:
    """Read the activity of processes from /proc; processes that are gone count as idle."""
    switches, busy = 0, False
    for pid in pids:
        tasks = f"/proc/{pid}/task"
        try:
            threads = os.listdir(tasks)
        except OSError:
            continue
        for thread in threads:
            try:
                with open(f"{tasks}/{thread}/status", "rb") as stream:
                    text = stream.read()
            except OSError:
                continue
            state = text.partition(b"State:\t")[2][:1]
            busy = busy or state in (b"R", b"D")
            voluntary = text.partition(b"\nvoluntary_ctxt_switches:\t")[2].partition(b"\n")[0]
            involuntary = text.partition(b"\nnonvoluntary_ctxt_switches:\t")[2].partition(b"\n")[0]
            switches += int(voluntary or 0) + int(involuntary or 0)
    return Activity(switches, busy)


def wait_sent(*, timeout: float) -> bool:
    """Wait until no Zenoh thread of this process wants the processor: what was put is on its way.

    A transmission that was not yet carried out leaves its thread runnable, however long the processor is busy.
    """
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if not any(_wants_processor(f"/proc/self/task/{thread}") for thread in os.listdir("/proc/self/task")):
            return True
        time.sleep(_POLL)
    return False


def _wants_processor(task: str) -> bool:
    try:
        with open(f"{task}/stat", "rb") as stream:
            name, _, rest = stream.read().partition(b"(")[2].rpartition(b")")
    except OSError:
        return False
    return name.startswith(_ZENOH_THREADS) and rest.split()[0] in (b"R", b"D")


def wait_settled(
    pids: Sequence[int],
    *,
    window: float,
    timeout: float,
    idle_rate: float = 0.0,
    since: Activity | None = None,
    alive: Callable[[], bool] = lambda: True,
) -> bool:
    """Wait until the processes have stood still for `window` seconds, or one of them has died.

    Args:
        pids: The processes.
        window: Seconds without activity that count as settled.
        timeout: Deadline in seconds.
        idle_rate: Context switches per second that the processes show without any input (timers of their own).
        since: Activity before the last input; until the processes have moved past it (at most ten windows) they
            have not received that input yet.
        alive: False when waiting has become pointless.

    Returns:
        False when the deadline passed while they were still busy.
    """
    start = time.monotonic()
    calm_since, calm_switches = start, -1
    received = since is None
    while True:
        seen = activity(pids)
        now = time.monotonic()
        if not alive():
            return True
        allowed = 2.0 * idle_rate * (now - calm_since) + (1 if idle_rate else 0)
        if seen.busy or calm_switches < 0 or seen.switches - calm_switches > allowed:
            calm_since, calm_switches = now, seen.switches
        if since is not None and seen.switches > since.switches:
            received = True
        if not received and now - start > 10 * window:
            received = True
        if received and now - calm_since >= window:
            return True
        if now - start > timeout:
            return False
        time.sleep(_POLL)
