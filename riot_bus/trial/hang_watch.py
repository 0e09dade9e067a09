"""Early detection of known hangs while riot waits for a unit (see `hangs`)."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from riot_bus.processes.python_report import deepest_common
from riot_bus.trial.hangs import hang_stacks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.processes.activity import Activity
    from riot_bus.processes.python_report import ThreadStack
    from riot_bus.trial.baseline import Baseline
    from riot_bus.trial.hangs import Hangs, HangStacks
    from riot_bus.trial.network import TrialNetwork
    from riot_bus.trial.observation import Observation

_STEP, LOOKS = 0.25, 3
"""Seconds between two looks at the stacks, and the number of looks that have to agree. A look takes some milliseconds
of the unit's time."""


class HangWatch:
    """Tells, when called repeatedly while riot waits for a unit, whether the unit is in a known hang.

    Args:
        timeout: Seconds after which the unit counts as hanging in any case.

    Attributes:
        known: Whether the unit is in a known hang.
        longest: Longest time that the unit was busy without an output before it continued, in seconds.
        taken_for: Known hang for which the unit was mistaken before it continued.
    """

    def __init__(
        self,
        hangs: Hangs,
        network: TrialNetwork,
        observation: Observation,
        name: str,
        baseline: Baseline,
        *,
        timeout: float,
    ) -> None:
        self.known, self.longest = False, 0.0
        self.taken_for: HangStacks | None = None
        self._hangs, self._network, self._observation = hangs, network, observation
        self._name, self._baseline, self._timeout = name, baseline, timeout
        self._waits = hangs.may_wait(timeout)
        self._restart()

    def _restart(self) -> None:
        self._next = time.monotonic() + _STEP
        self._outputs = len(self._network.outputs)
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
        if len(self._network.outputs) != self._outputs:
            self.went_on()
            return False
        self._next, seen = now + _STEP, self._observation.activity([self._name])
        if self._since is None:
            self._since = now, seen
            return False
        begin, before = self._since
        self._busy = now - begin - seen.waited_since(before)  # a loaded machine is not a hang
        if self._hangs:
            self._looks = [*self._looks, self._observation.stacks(self._name)][-LOOKS:]
            stacks = deepest_common(self._looks)
            place = hang_stacks(stacks, self._baseline.blocked(stacks, anywhere=True))
            agreed = len(self._looks) == LOOKS
            if agreed and self._hangs.is_known(place, busy=self._busy, timeout=self._timeout):
                self.known, self._stands = not self._waits, place
        return self.known
