"""Hangs of a unit that were waited for to the end: where it stands so again, the same is told much sooner.

A unit that still works and one that never ends look alike for as long as nobody waits. So a hang is waited for until
`settle.timeout` at first. From then on the same is told of a unit that is busy, has the very same stacks at several
looks and publishes nothing, for three times as long as it was ever seen so before it went on: slow units get more time.
Now and then such a hang is waited for to the end nevertheless, and if the unit goes on, it is no longer known.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, TypeAlias

from riot_bus.sut.python_report import deepest_common

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from riot_bus.sut.activity import Activity
    from riot_bus.sut.baseline import Baseline
    from riot_bus.sut.python_report import ThreadStack
    from riot_bus.sut.stage import TrialSetup

__all__ = ["HangStacks", "Hangs", "Watch", "hang_stacks"]

HangStacks: TypeAlias = frozenset[tuple[str, ...]]
"""The stacks of the threads that stand where none does at rest; empty of a program that is not Python."""

_PATIENCE, _TIMES = 0.75, 3.0
_BLIND = 0.3
"""Of the timeout: least patience where no stacks tell a hang from work."""
_SHARE = 0.1
"""Of the time of all trials: beyond it, no known hang is waited for to the end."""
_STEP, _LOOKS = 0.25, 3
"""Seconds between two looks, and how many have to agree. A look interrupts the unit for some milliseconds."""


def hang_stacks(stacks: Sequence[ThreadStack], blocked: Collection[str]) -> HangStacks:
    """Return where a unit hangs.

    Args:
        stacks: Where its threads stand.
        blocked: Functions in which threads stand that stand elsewhere at rest.
    """
    return frozenset(stack.functions for stack in stacks if stack.functions[0] in blocked)


class Hangs:
    """What trials of one unit have shown of its hangs. Usable from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: set[HangStacks] = set()
        self._longest = self._trials = self._waited = 0.0

    def __bool__(self) -> bool:
        return bool(self._known)

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


class Watch:
    """Tells, asked again and again while a unit is waited for, whether it hangs as it did before.

    Args:
        hangs: What is known of the unit.
        stage: Where it runs.
        name: Its component.
        baseline: What it does in nominal trials.
        timeout: Seconds after which it hangs in any case.

    Attributes:
        known: Whether it hangs as it did before.
        longest: For how many seconds it was busy without an output before it went on.
        taken_for: The known hang that it was taken for before it went on.
    """

    def __init__(self, hangs: Hangs, stage: TrialSetup, name: str, baseline: Baseline, *, timeout: float) -> None:
        self.known, self.longest = False, 0.0
        self.taken_for: HangStacks | None = None
        self._hangs, self._stage, self._names, self._baseline, self._timeout = hangs, stage, [name], baseline, timeout
        self._waits = hangs.may_wait(timeout)
        self._restart()

    def _restart(self) -> None:
        self._next = time.monotonic() + _STEP
        self._outputs = len(self._stage.outputs)
        self._since: tuple[float, Activity] | None = None
        self._busy = 0.0
        self._stands: HangStacks | None = None
        self._looks: list[Sequence[ThreadStack]] = []

    def went_on(self) -> None:
        """Note that the unit has gone on."""
        self.longest, self.taken_for = max(self.longest, self._busy), self._stands or self.taken_for
        self._restart()

    def __call__(self) -> bool:
        """Return whether it hangs."""
        now = time.monotonic()
        if self.known or now < self._next:
            return self.known
        if len(self._stage.outputs) != self._outputs:
            self.went_on()
            return False
        self._next, seen = now + _STEP, self._stage.activity(self._names)
        if self._since is None:
            self._since = now, seen
            return False
        begin, before = self._since
        self._busy = now - begin - seen.waited_since(before)  # a loaded machine is no hang
        if self._hangs:
            self._looks = [*self._looks, self._stage.stacks(self._names)][-_LOOKS:]
            stacks = deepest_common(self._looks)
            place = hang_stacks(stacks, self._baseline.blocked(stacks, anywhere=True))
            agreed = len(self._looks) == _LOOKS
            if agreed and self._hangs.is_known(place, busy=self._busy, timeout=self._timeout):
                self.known, self._stands = not self._waits, place
        return self.known
