"""What processes have done so far: context switches and shares of the processors, from /proc."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.monitors.model import ResourceSample

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["STILL", "Activity", "Idle", "Shares", "activity", "families", "idle_between", "resources", "shares"]

_LEAST_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Activity:
    """Voluntary context switches so far of a group of processes, and whether a thread of theirs wants a processor."""

    switches: int
    busy: bool


@dataclass(frozen=True, slots=True)
class Shares:
    """What a group of processes has had of the processors so far, by thread.

    Attributes:
        ran: Seconds in which the thread ran.
        waited: Seconds in which it could have run, but others had the processors.
    """

    ran: Mapping[int, float]
    waited: Mapping[int, float]

    def ran_since(self, before: Shares) -> float:
        """Return the seconds in which the processes have run, summed over their threads."""
        return sum(ran - before.ran.get(thread, 0.0) for thread, ran in self.ran.items())

    def had_since(self, before: Shares, *, seconds: float) -> float:
        """Return those of some seconds in which the processes were not held up, a tenth of them at least."""
        return max(seconds - self.waited_since(before), seconds * _LEAST_SHARE)

    def share_since(self, before: Shares, *, seconds: float) -> float:
        """Return the share of these seconds in which they ran."""
        return self.ran_since(before) / self.had_since(before, seconds=seconds)

    def waited_since(self, before: Shares) -> float:
        """Return the seconds in which the processes were held up by others: those of the thread that waited longest."""
        return max((waited - before.waited.get(thread, 0.0) for thread, waited in self.waited.items()), default=0.0)


@dataclass(frozen=True, slots=True)
class Idle:
    """What processes do without any input, because of timers of their own.

    Attributes:
        switches: Voluntary context switches per second.
        ran: Seconds in which they run, per second.
    """

    switches: float = 0.0
    ran: float = 0.0

    def or_more(self, other: Idle) -> Idle:
        """Return the more of both."""
        return Idle(max(self.switches, other.switches), max(self.ran, other.ran))


STILL = Idle()
"""Nothing."""


def idle_between(before: tuple[Activity, Shares], after: tuple[Activity, Shares], *, seconds: float) -> Idle:
    """Return what processes do from what they have done.

    Args:
        before: At the begin.
        after: At the end.
        seconds: In between. What they had to wait for a processor is taken off: in that time they could do nothing.
    """
    had = after[1].had_since(before[1], seconds=seconds)
    return Idle((after[0].switches - before[0].switches) / had, after[1].ran_since(before[1]) / had)


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
    for task in _tasks(pids):
        text = _read(f"{task}/status")
        busy = busy or text.partition(b"State:\t")[2][:1] in (b"R", b"D")
        switches += int(text.partition(b"\nvoluntary_ctxt_switches:\t")[2].partition(b"\n")[0] or 0)
    return Activity(switches, busy)


def shares(pids: Sequence[int]) -> Shares:
    """Read from /proc what processes have had of the processors; nothing where the kernel does not tell."""
    ran, waited = {}, {}
    for task in _tasks(pids):
        numbers = _read(f"{task}/schedstat").split()
        if len(numbers) == 3:
            thread = int(task.rpartition("/")[2])
            ran[thread], waited[thread] = int(numbers[0]) / 1e9, int(numbers[1]) / 1e9
    return Shares(ran, waited)


def resources(pids: Sequence[int], *, messages: int) -> ResourceSample:
    """Read from /proc what processes have of the machine; processes that are gone count as nothing.

    Args:
        pids: The processes.
        messages: Inputs that had been published by now.
    """
    memory = files = threads = 0
    for pid in pids:
        memory += int(_read(f"/proc/{pid}/status").partition(b"VmRSS:")[2].split(b"kB")[0] or 0) << 10
        with suppress(OSError):
            files += len(os.listdir(f"/proc/{pid}/fd"))
            threads += len(os.listdir(f"/proc/{pid}/task"))
    return ResourceSample(time.time_ns(), messages, memory, files, threads)


def _tasks(pids: Sequence[int]) -> list[str]:
    found = []
    for pid in pids:
        with suppress(OSError):
            found += [f"/proc/{pid}/task/{thread}" for thread in os.listdir(f"/proc/{pid}/task")]
    return found


def _read(file: str) -> bytes:
    try:
        with open(file, "rb", buffering=0) as stream:
            return stream.read()
    except OSError:
        return b""
