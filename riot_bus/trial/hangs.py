"""Known hangs of a unit, by their stacks, so that the same hang is detected much sooner than by the timeout.

Only time tells a unit that still works from one that never ends. So the first hang is waited for until
`settle.timeout`. From then on, a unit hangs if it is busy, stands in the same functions at several looks and publishes
nothing for three times as long as it was ever seen busy before it continued: slow units get more time. Now and then,
riot waits for a known hang to the timeout nevertheless, and forgets it if the unit continues. Workers share what is
known with each other and with later commands.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from riot_bus.processes.python_report import deepest_common

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from riot_bus.processes.activity import Activity
    from riot_bus.processes.python_report import ThreadStack
    from riot_bus.trial.baseline import Baseline


HangStacks: TypeAlias = frozenset[tuple[str, ...]]
"""Stacks of the threads that stand where no thread stands at rest; empty for a program that is not Python."""
_PATIENCE, _TIMES = 0.75, 3.0
_BLIND = 0.3
"""Least patience if there are no stacks that tell a hang from work, as a share of the timeout."""
_STEP, LOOKS = 0.25, 3
"""Seconds between two looks at the stacks, and the number of looks that have to agree. A look takes some milliseconds
of the unit's time."""


def hang_stacks(stacks: Sequence[ThreadStack], blocked: Collection[str]) -> HangStacks:
    """Return the stacks that identify a hang."""
    return frozenset(stack.functions for stack in stacks if stack.functions[0] in blocked)


@dataclass(frozen=True, slots=True)
class KnownHangs:
    """Known hangs of one unit, in the form in which processes exchange them.

    Attributes:
        places: Stacks of each known hang (see `HangStacks`), sorted.
        longest: Longest time that the unit was busy without an output before it continued, in seconds.
    """

    places: tuple[tuple[tuple[str, ...], ...], ...] = ()
    longest: float = 0.0

    def changed(self, told: KnownHangs, found: KnownHangs) -> KnownHangs:
        """Return the known hangs with those that a process has added, and without those that it has removed."""
        gone = set(told.places) - set(found.places)
        places = {*self.places, *found.places} - gone
        return KnownHangs(tuple(sorted(places)), max(self.longest, found.longest))


class Hangs:
    """Known hangs of one unit; usable from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: set[HangStacks] = set()
        self._longest = self._trials = self._waited = 0.0

    def __bool__(self) -> bool:
        return bool(self._known)

    def know(self, told: KnownHangs) -> None:
        """Replace the known hangs by those of all processes, which include the ones that this process reported."""
        with self._lock:
            self._known = set(map(frozenset, told.places))
            self._longest = max(self._longest, told.longest)

    def tell(self) -> KnownHangs:
        """Return the hangs that are known now."""
        with self._lock:
            return KnownHangs(tuple(sorted(tuple(sorted(place)) for place in self._known)), self._longest)

    def is_known(self, place: HangStacks, *, busy: float, timeout: float) -> bool:
        """Return whether a unit is in a known hang."""
        patience = max(_PATIENCE if place else _BLIND * timeout, _TIMES * self._longest)
        return place in self._known and busy >= patience

    def may_wait(self, timeout: float) -> bool:
        """Return whether hangs took so little time so far that riot can wait for a known one to the timeout."""
        return self._waited + timeout <= 0.1 * self._trials  # of the time of all trials

    def add(self, place: HangStacks, *, waited: float) -> None:
        """Add a hang that was waited for to the timeout, for `waited` seconds."""
        with self._lock:
            self._waited += waited
            self._known.add(place)

    def ended(self, seconds: float, *, busy: float = 0.0, taken_for: HangStacks | None = None) -> None:
        """Note the end of a trial.

        Args:
            busy: Longest time that the unit was busy without an output before it continued, in seconds; 0 if it hung.
            taken_for: Known hang for which the unit was mistaken before it continued.
        """
        with self._lock:
            self._trials += seconds
            self._longest = max(self._longest, busy)
            self._known -= {taken_for}


class HangWatch:
    """Tells, when called repeatedly while riot waits for a unit, whether the unit is in a known hang."""

    def __init__(
        self,
        hangs: Hangs,
        baseline: Baseline,
        *,
        outputs: Callable[[], int],
        activity: Callable[[], Activity],
        stacks: Callable[[], Sequence[ThreadStack]],
        timeout: float,
    ) -> None:
        self.known, self.longest = False, 0.0
        self.taken_for: HangStacks | None = None
        self._hangs, self._baseline, self._count = hangs, baseline, outputs
        self._activity, self._unit_stacks = activity, stacks
        self._timeout, self._waits = timeout, hangs.may_wait(timeout)
        self._restart()

    def _restart(self) -> None:
        self._next = time.monotonic() + _STEP
        self._outputs = self._count()
        self._since: tuple[float, Activity] | None = None
        self._busy = 0.0
        self._stands: HangStacks | None = None
        self._looks: list[Sequence[ThreadStack]] = []

    def went_on(self) -> None:
        """Note that the unit has continued."""
        self.longest, self.taken_for = max(self.longest, self._busy), self._stands or self.taken_for
        self._restart()

    def __call__(self) -> bool:
        """Return whether the unit is in a known hang."""
        now = time.monotonic()
        if self.known or now < self._next:
            return self.known
        if self._count() != self._outputs:
            self.went_on()
            return False
        self._next, seen = now + _STEP, self._activity()
        if self._since is None:
            self._since = now, seen
            return False
        begin, before = self._since
        self._busy = now - begin - seen.waited_since(before)  # a loaded machine is not a hang
        if self._hangs:
            self._looks = [*self._looks, self._unit_stacks()][-LOOKS:]
            stacks = deepest_common(self._looks)
            place = hang_stacks(stacks, self._baseline.blocked(stacks, anywhere=True))
            agreed = len(self._looks) == LOOKS
            if agreed and self._hangs.is_known(place, busy=self._busy, timeout=self._timeout):
                self.known, self._stands = not self._waits, place
        return self.known
