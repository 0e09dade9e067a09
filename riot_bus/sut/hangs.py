"""Hangs of a unit that were waited for to the end: where it stands so again, the same is told much sooner.

A unit that still works and one that never ends look alike for as long as nobody waits. So a hang is waited for until
`settle.timeout` at first. From then on the same is told of a unit that is busy, has the very same stacks at several
looks and publishes nothing, for three times as long as it was ever seen so before it went on: slow units get more time.
Now and then such a hang is waited for to the end nevertheless, and if the unit goes on, it is no longer known. Workers
tell each other, and later commands, what is known.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from riot_bus.sut.python_report import ThreadStack

__all__ = ["HangStacks", "Hangs", "KnownHangs", "hang_stacks"]

HangStacks: TypeAlias = frozenset[tuple[str, ...]]
"""The stacks of the threads that stand where none does at rest; empty of a program that is not Python."""

_PATIENCE, _TIMES = 0.75, 3.0
_BLIND = 0.3
"""Of the timeout: least patience where no stacks tell a hang from work."""
_SHARE = 0.1
"""Of the time of all trials: beyond it, no known hang is waited for to the end."""


def hang_stacks(stacks: Sequence[ThreadStack], blocked: Collection[str]) -> HangStacks:
    """Return where a unit hangs.

    Args:
        stacks: Where its threads stand.
        blocked: Functions in which threads stand that stand elsewhere at rest.
    """
    return frozenset(stack.functions for stack in stacks if stack.functions[0] in blocked)


@dataclass(frozen=True, slots=True)
class KnownHangs:
    """What trials of one unit have shown of its hangs, as other processes are told.

    Attributes:
        places: Stacks of each known hang, as of `HangStacks`, sorted.
        longest: For how many seconds the unit was busy without an output before it went on, at most.
    """

    places: tuple[tuple[tuple[str, ...], ...], ...] = ()
    longest: float = 0.0

    def changed(self, told: KnownHangs, found: KnownHangs) -> KnownHangs:
        """Return it with what a process has added, and without what it has taken away.

        Args:
            told: What the process was told.
            found: What it tells now.
        """
        gone = set(told.places) - set(found.places)
        places = {*self.places, *found.places} - gone
        return KnownHangs(tuple(sorted(places)), max(self.longest, found.longest))


class Hangs:
    """What trials of one unit have shown of its hangs. Usable from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: set[HangStacks] = set()
        self._longest = self._trials = self._waited = 0.0

    def __bool__(self) -> bool:
        return bool(self._known)

    def know(self, told: KnownHangs) -> None:
        """Go on with what trials of other processes have shown, too; they are told what those of this one have."""
        with self._lock:
            self._known = set(map(frozenset, told.places))
            self._longest = max(self._longest, told.longest)

    def tell(self) -> KnownHangs:
        """Return what is known by now."""
        with self._lock:
            return KnownHangs(tuple(sorted(tuple(sorted(place)) for place in self._known)), self._longest)

    def is_known(self, place: HangStacks, *, busy: float, timeout: float) -> bool:
        """Return whether a unit hangs as it did before.

        Args:
            place: Where it stands.
            busy: For how many seconds it has been busy without an output.
            timeout: Those after which it hangs in any case.
        """
        patience = max(_PATIENCE if place else _BLIND * timeout, _TIMES * self._longest)
        return place in self._known and busy >= patience

    def may_wait(self, timeout: float) -> bool:
        """Return whether hangs took so little time up to now that a known one can be waited for to the end."""
        return self._waited + timeout <= _SHARE * self._trials

    def add(self, place: HangStacks, *, waited: float) -> None:
        """Take in a hang that was waited for to the end, for so many seconds."""
        with self._lock:
            self._waited += waited
            self._known.add(place)

    def ended(self, seconds: float, *, busy: float = 0.0, taken_for: HangStacks | None = None) -> None:
        """Take in the end of a trial.

        Args:
            seconds: How long it took.
            busy: For how many seconds the unit was busy without an output before it went on; 0 where it hung.
            taken_for: The known hang that it was taken for before it went on.
        """
        with self._lock:
            self._trials += seconds
            self._longest = max(self._longest, busy)
            self._known -= {taken_for}
