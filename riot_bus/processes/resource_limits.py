"""Resource limits of a component, watched from outside, so that nothing changes for components within their limits.

The kernel's limits (setrlimit) are unsuitable. Those of memory count what sanitizers, runtimes and stacks of threads
reserve and never use; that of processes counts all processes of a user and none of root's; and each program reports a
refused file or memory in its own way, if at all. The supervisor uses this module, with the standard library only.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from riot_bus.processes.activity import families, read_proc, resources

LOOK_S = 0.05
"""Seconds between two looks: a program that fills memory as fast as it can, some GB a second, is 0.2 GB over."""
_TICKS, _PAGE = os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")


class Guard:
    """Watches one component and all its descendants.

    Args:
        limits: Limits of `memory` (bytes), `files`, `processes` and `cpu` (seconds); 0 for no limit.
    """

    def __init__(self, pid: int, limits: Mapping[str, float]) -> None:
        self._pid, self._limits = pid, limits
        self._family: Sequence[int] = [pid]
        self._others: Sequence[int] = ()
        self._looks = 0

    def include(self, pids: Sequence[int]) -> None:
        """Watch other processes and their descendants, too, such as a container's, which are not descendants here."""
        self._others = pids

    def excess(self, orphans: Sequence[int] = ()) -> tuple[str, float] | None:
        """Return the resource whose limit the component exceeds, and its amount; None if there is none.

        Args:
            orphans: Ids of processes that it has started and that are no longer its descendants.
        """
        had: dict[str, float] = {}
        if self._looks % 4 == 0:  # this takes ten times as long as the rest
            self._family = families([*dict.fromkeys([self._pid, *self._others, *orphans])])
            sample = resources(self._family, messages=0)
            had = {"files": sample.files, "processes": len(self._family), "cpu": sum(map(_cpu, self._family))}
        self._looks += 1
        had["memory"] = sum(map(_resident, self._family))
        if len(self._family) > 1 and had["memory"] > self._limits["memory"] > 0:
            had["memory"] = sum(map(_own, self._family))  # forked processes share most of theirs
        over = (what for what, limit in self._limits.items() if 0 < limit < had.get(what, 0))
        return next(((what, had[what]) for what in over), None)

    def pids(self) -> Sequence[int]:
        """Return the processes that were seen at the last look at all of them."""
        return self._family


def amount_text(what: str, amount: float) -> str:
    """Return an amount of a limited resource as text."""
    return {"memory": f"{amount / (1 << 20):,.0f} MiB", "cpu": f"{amount:.0f} s"}.get(what, f"{amount:.0f}")


def _resident(pid: int) -> int:
    return int((read_proc(f"/proc/{pid}/statm").split() or [b"0", b"0"])[1]) * _PAGE


def _own(pid: int) -> int:
    """Return the bytes of a process; those that it shares with others are divided among them, if this user may know."""
    told = read_proc(f"/proc/{pid}/smaps_rollup")
    return int((told.partition(b"\nPss:")[2].split() or [b"0"])[0]) << 10 if told else _resident(pid)


def _cpu(pid: int) -> float:
    """Return the seconds in which a process has run, and those of its children that are gone."""
    return sum(map(int, read_proc(f"/proc/{pid}/stat").rpartition(b") ")[2].split()[11:15])) / _TICKS
