"""How the threads of a busy router share the processors."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_BUSY, _CALM = 0.6, 0.4  # shares of one processor; the gap prevents switching to and fro at a steady load
_AGAIN_S = 5.0  # reads a file in /proc for each thread, up to 128 of them receive threads per segment
_TASKS = Path("/proc/self/task")
_ZENOH = (b"rx-", b"tx-")


class LoadScheduling:
    """Keeps Zenoh's threads from interrupting others while the process is busy; to be called often, on Linux only.

    A thread that wakes up may take the processor from the running one, which usually has just woken it. In a flood,
    that happens to a lane that fetches and publishes messages, up to 30,000 times a second, to send a few messages that
    could as well have gone with the next hundred. Batch scheduling (sched(7)) makes woken threads wait for their turn.

    The price: while all processors are busy, a single message may wait 2 ms longer. So this is for times in which many
    messages come at once. A process that was started with a policy of its own keeps it.
    """

    def __init__(self, used: Callable[[], float] = time.process_time) -> None:
        self.batched = False
        """Whether Zenoh's threads wait for their turn at present."""
        self._own = not hasattr(os, "SCHED_BATCH") or os.sched_getscheduler(0) != os.SCHED_OTHER
        self._used = used
        self._last = time.monotonic(), used()
        self._again = 0.0

    def __call__(self) -> None:
        """Look how busy the process was since the last call, and act if that has changed."""
        now, used = time.monotonic(), self._used()
        passed = now - self._last[0]
        if passed < 0.1:  # it would show single bursts; calls come about every 0.2 s
            return
        share = (used - self._last[1]) / passed
        self._last = now, used
        if share > _BUSY and (not self.batched or now > self._again):
            self.batch()
            self._again = now + _AGAIN_S  # for threads that began later
        elif share < _CALM and self.batched:
            self.release()

    def batch(self) -> None:
        """Let Zenoh's threads wait for their turn, including new ones."""
        if not self._own:
            self.batched = True
            _switch(os.SCHED_OTHER, os.SCHED_BATCH)

    def release(self) -> None:
        """Let Zenoh's threads run again as soon as they wake up."""
        if not self._own:
            self.batched = False
            _switch(os.SCHED_BATCH, os.SCHED_OTHER)


def _switch(before: int, after: int) -> None:
    tasks: list[Path] = []
    with suppress(OSError):  # there is no /proc here
        tasks = list(_TASKS.iterdir())
    for task in tasks:
        with suppress(OSError):  # it has ended, or must not be changed
            if (task / "comm").read_bytes().startswith(_ZENOH) and os.sched_getscheduler(int(task.name)) == before:
                os.sched_setscheduler(int(task.name), after, os.sched_param(0))
