"""The activity of processes so far: context switches and processor time, from /proc."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from riot_bus.monitors.model import ResourceSample

_TELLS_TIMES = os.path.exists("/proc/self/schedstat")


@dataclass(frozen=True, slots=True)
class Activity:
    """The activity of a group of processes so far.

    Attributes:
        threads: By thread, the nanoseconds for which it ran, the nanoseconds for which it waited for a processor, and
            how often it got a processor.
    """

    threads: Mapping[int, tuple[int, int, int]]

    @property
    def switches(self) -> int:
        """Number of times that threads got a processor."""
        return sum(switches for _, _, switches in self.threads.values())

    def ran_since(self, before: Activity) -> float:
        """Return the seconds for which the processes have run, summed over their threads."""
        return sum(times[0] - before.of(thread)[0] for thread, times in self.threads.items()) / 1e9

    def had_since(self, before: Activity, *, seconds: float) -> float:
        """Return how many of these seconds the processes did not wait for a processor, at least a tenth of them."""
        # it is a divisor, and near 0 if all time was spent waiting; then rates had no bound
        return max(seconds - self.waited_since(before), seconds * 0.1)

    def waited_since(self, before: Activity) -> float:
        """Return the seconds for which the thread that waited longest has waited for a processor."""
        return max((times[1] - before.of(thread)[1] for thread, times in self.threads.items()), default=0) / 1e9

    def of(self, thread: int) -> tuple[int, int, int]:
        """Return the values of one thread; zeros if it is not known."""
        return self.threads.get(thread, (0, 0, 0))


@dataclass(frozen=True, slots=True)
class Idle:
    """The activity of processes without any input, because of their own timers.

    Attributes:
        switches: Voluntary context switches per second.
        ran: Processor time in seconds per second.
    """

    switches: float = 0.0
    ran: float = 0.0

    def or_more(self, other: Idle) -> Idle:
        """Return the larger value of each attribute."""
        return Idle(max(self.switches, other.switches), max(self.ran, other.ran))


STILL = Idle()
"""No activity at all."""


def idle_between(before: Activity, after: Activity, *, seconds: float) -> Idle:
    """Return the rates of activity between two moments."""
    had = after.had_since(before, seconds=seconds)
    return Idle((after.switches - before.switches) / had, after.ran_since(before) / had)


class Threads:
    """All threads of some processes, observed through files that stay open.

    A process with Zenoh has forty threads; opening their files for each reading took most of a trial's time.

    Args:
        pids: Ids of the processes; ended ones count as inactive.
        names: Prefixes of the names of the threads; others are left out.
    """

    def __init__(self, pids: Iterable[int], *, names: tuple[bytes, ...] = (b"",), but: int = 0) -> None:
        self.pids = tuple(pids)
        self._names, self._but = names, but
        self._counts: tuple[int, ...] = ()
        self._files: dict[int, tuple[int, int]] = {}
        self._called: dict[int, bytes] = {}
        self._ran: dict[int, int] = {}
        self._more: dict[str, dict[int, int]] = {"syscall": {}, "children": {}}

    def activity(self) -> Activity:
        """Return the activity of the present threads so far."""
        found = self._read_times()
        return Activity(found if self._counts else self._read_times())

    def _read_times(self) -> dict[int, tuple[int, int, int]]:
        self._find()
        found = {}
        for thread, (file, _) in self._files.items():
            try:
                found[thread] = _times(os.pread(file, 4096, 0))
            except (OSError, ValueError):  # it has ended just now, and another one may have begun
                self._counts = ()
        return found

    def ran(self) -> int:
        """Return a number that grows whenever one of the threads runs: their processor time so far, in nanoseconds.

        Of whole processes, this takes one system call each. The time of a thread that runs at the moment may be added
        only when it stops. Where the kernel does not count nanoseconds, it is the number of context switches.
        """
        if not _TELLS_TIMES:
            return self.activity().switches
        some = self._names != (b"",) or self._but  # threads have clocks in their own process only
        now = {} if some else self._ran  # a process that has ended keeps its time
        for one in self._files if some else self.pids:
            with suppress(OSError):
                now[one] = time.clock_gettime_ns(~one << 3 | (6 if some else 2))  # as clock_getcpuclockid(3)
        return sum(now.values())

    def rests(self, before: int) -> bool:
        """Return whether all threads sleep, and none has run since `before`, a result of `ran`.

        Threads are looked at one after the other, and one may wake another that was looked at before; but then it has
        run itself, as has one that starts another.
        """
        return not self.busy() and self.ran() == before

    def busy(self, *, new: bool = True) -> bool:
        """Return whether a thread runs, could run, or is stopped by a tracer; unless `new`, only of known threads."""
        if new:
            self._find()
        for _, file in self._files.values():
            try:
                if os.pread(file, 512, 0).rpartition(b") ")[2][:1] in (b"R", b"D", b"t"):
                    return True
            except OSError:  # as in `_read_times`
                self._counts = ()
        if self._counts or not new:
            return False
        self._find()
        return self.busy(new=False)

    def calls(self) -> Iterator[tuple[int, bytes, bytes]]:
        """Yield each thread, its name, and its current system call.

        The latter is a line of /proc/PID/task/THREAD/syscall, empty if this process may not read it.
        """
        self._find()
        for thread in self._files:
            yield thread, self._called[thread], self._read_more("syscall", thread)

    def has_all_of(self, roots: Iterable[int]) -> bool:
        """Return whether the processes are the given ones and all that `families` returns for them.

        This takes less time than `families`; False where one thread has hundreds of children.
        """
        self._find()
        children = b" ".join(self._read_more("children", thread) for thread in self._files)
        return set(self.pids) == {*roots, *map(int, children.split())}

    def _read_more(self, name: str, thread: int) -> bytes:
        """Return what a further file of a thread says; empty if this process may not read it."""
        files = self._more[name]
        try:
            if thread not in files:
                files[thread] = os.open(f"/proc/{thread}/task/{thread}/{name}", os.O_RDONLY)
            return os.pread(files[thread], 4096, 0)
        except OSError:
            return b""

    def switches_of(self, thread: int) -> int:
        """Return how often one known thread got a processor; -1 if it has ended."""
        with suppress(OSError, ValueError):
            return _times(os.pread(self._files[thread][0], 4096, 0))[2]
        return -1

    def close(self) -> None:
        """Close all files."""
        for thread in list(self._files):
            self._drop(thread)
        self._called.clear()

    def _drop(self, thread: int) -> None:
        more = [files.pop(thread) for files in self._more.values() if thread in files]
        for file in (*self._files.pop(thread), *more):
            os.close(file)

    def _find(self) -> None:
        """Open the files of new threads, and close those of ended ones."""
        counts = tuple(map(_threads_of, self.pids))
        if counts == self._counts and self._names == (b"",):
            return
        self._counts = counts
        now: dict[int, str] = {}
        for pid in self.pids:
            with suppress(OSError):
                now |= {int(name): f"/proc/{pid}/task/{name}" for name in os.listdir(f"/proc/{pid}/task")}
        for thread in self._files.keys() - now.keys():
            self._drop(thread)
        for thread in self._called.keys() - now.keys():
            del self._called[thread]
        for thread in now.keys() - self._files.keys():
            if thread in self._called:  # it was left out
                continue
            self._called[thread] = name = read_proc(f"{now[thread]}/comm")
            if thread == self._but or not name.startswith(self._names):
                continue
            with suppress(OSError):
                times = os.open(f"{now[thread]}/{'schedstat' if _TELLS_TIMES else 'status'}", os.O_RDONLY)
                try:
                    self._files[thread] = times, os.open(f"{now[thread]}/stat", os.O_RDONLY)
                except OSError:
                    os.close(times)


def _threads_of(pid: int) -> int:
    """Return a number that depends on how many threads a process has; 0 if it has ended."""
    try:
        return os.stat(f"/proc/{pid}/task").st_nlink
    except OSError:
        return 0


def _times(text: bytes) -> tuple[int, int, int]:
    if _TELLS_TIMES:
        ran, waited, switches = text.split()
        return int(ran), int(waited), int(switches)
    return 0, 0, int(text.partition(b"\nvoluntary_ctxt_switches:\t")[2].partition(b"\n")[0])


def families(pids: Sequence[int]) -> list[int]:
    """Return processes and all their running descendants, such as the node behind `ros2 run`."""
    found = list(pids)
    for pid in found:
        with suppress(OSError):
            for thread in os.listdir(f"/proc/{pid}/task"):
                children = read_proc(f"/proc/{pid}/task/{thread}/children").split()
                found += [child for child in map(int, children) if child not in found]
    return found


def resources(pids: Sequence[int], *, messages: int) -> ResourceSample:
    """Read the resources of processes from /proc; ended processes count as nothing."""
    memory = files = threads = 0
    for pid in pids:
        memory += int(read_proc(f"/proc/{pid}/status").partition(b"VmRSS:")[2].split(b"kB")[0] or 0) << 10
        with suppress(OSError):
            files += len(os.listdir(f"/proc/{pid}/fd"))
            threads += len(os.listdir(f"/proc/{pid}/task"))
    return ResourceSample(time.time_ns(), messages, memory, files, threads)


def out_of_memory_kills() -> int:
    """Return how many processes of this machine the kernel has killed for lack of memory; 0 if unknown."""
    return int(read_proc("/proc/vmstat").partition(b"\noom_kill ")[2].split(b"\n")[0] or 0)


def read_proc(file: str) -> bytes:
    """Return the content of a file below /proc; empty if it is gone or not readable."""
    try:
        with open(file, "rb", buffering=0) as stream:
            return stream.read()
    except OSError:
        return b""
