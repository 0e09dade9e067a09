"""What brought out behaviour that no trial before had shown: told apart from the rest of its trial, and built upon.

A fault may need several steps, each of which shows: a message switches the unit into another mode, another one does
harm in it. So where a passing trial shows something new, parts of its group are tried until it is known which things it
comes of, and these happen in many trials from then on, with others around them.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from riot_bus.vocabulary.trial import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.campaign.variations import Placed, Variation
    from riot_bus.vocabulary.trial import Outcome

__all__ = ["Novelties"]

_MOST = 16
"""New things that are pursued: a unit that shows something new each time would have no end of them."""
_MOST_VALUES = 24
"""Of what has more, such as a field that shows what an input had, nothing is new any more."""
_STEPS, _TOGETHER = 60, 8
"""Trials until it is known which things new behaviour comes of, and how many these may be."""
_TIMES = 8
"""How often a single one happens in a trial at most when it is built upon: each time something may follow it."""

_Shown = frozenset[tuple[str, str]]
_Group = tuple["Placed", ...]


@dataclass(eq=False)
class _Pursuit:
    """The search for what behaviour comes of.

    Attributes:
        shown: The behaviour; a part shows it if it shows some of it.
        parts: Yields parts to try, and is sent whether they show it.
        part: The one to try now.
    """

    shown: _Shown
    parts: Generator[_Group, bool, _Group]
    part: _Group
    steps: int = 0


class Novelties:
    """Chooses what to try because of what trials have shown. Equal answers in equal order give equal choices.

    Args:
        seed: Seed of the choices.

    Attributes:
        kept: Things that something new came of, those that it came of together on the same messages as then.
    """

    def __init__(self, *, seed: int) -> None:
        self._random = random.Random(f"novelties:{seed}")  # noqa: S311
        self._known: dict[str, set[str]] = {}
        self._waiting: deque[_Pursuit] = deque()
        self._tried: dict[_Group, _Pursuit] = {}
        self._pursued = 0
        self.kept: list[_Group] = []

    def know(self, outcomes: Iterable[Outcome]) -> None:
        """Take in what nominal trials show."""
        for outcome in outcomes:
            self._new(outcome)

    def learn(self, group: Sequence[Placed], outcome: Outcome) -> None:
        """Take in a passing trial of things that were tried together."""
        new = self._new(outcome)
        if new and group and self._pursued < _MOST:
            self._pursued += 1
            parts = _minimal(tuple(group))
            self._go_on(_Pursuit(new, parts, ()), None)

    def next(self) -> _Group:
        """Return a part of a group, to see whether it shows what the whole one did; nothing if there is none."""
        if not self._waiting or self._waiting[0].part in self._tried:  # the same may be asked for two reasons
            return ()
        pursuit = self._waiting.popleft()
        self._tried[pursuit.part] = pursuit
        return pursuit.part

    def take(self, group: _Group, outcome: Outcome, *, nominal_outputs: int) -> None:
        """Take in the outcome of a part."""
        del nominal_outputs
        passed = outcome.verdict is Verdict.PASS
        self._go_on(pursuit := self._tried.pop(group), passed and bool(pursuit.shown & _shown(outcome)))
        if passed:
            self._new(outcome)

    def seeds(self) -> tuple[list[Variation], _Group]:
        """Return what to build upon in a trial: a thing on any messages, or some on these; nothing if there is none."""
        if not self.kept:
            return [], ()
        group = self._random.choice(self.kept)
        if len(group) > 1 or group[0].item.first is not None:
            return [], tuple(replace(each, item=replace(each.item, again=True)) for each in group)
        return [replace(group[0].item, again=True, times=self._random.randint(1, _TIMES))], ()

    def _go_on(self, pursuit: _Pursuit, showed: bool | None) -> None:  # noqa: FBT001 - as a generator is sent it
        pursuit.steps += 1
        try:
            pursuit.part = next(pursuit.parts) if showed is None else pursuit.parts.send(showed)
        except StopIteration as end:
            if len(end.value) <= _TOGETHER:
                self.kept.append(end.value)
            return
        if pursuit.steps <= _STEPS:
            self._waiting.append(pursuit)

    def _new(self, outcome: Outcome) -> _Shown:
        """Return what of an outcome is new, and remember it."""
        new = set()
        for name, value in _shown(outcome):
            known = self._known.setdefault(name, set())
            if value not in known and len(known) < _MOST_VALUES:
                new.add((name, value))
        for name, value in new:
            self._known[name].add(value)
        return frozenset(new)


def _minimal(group: _Group) -> Generator[_Group, bool, _Group]:
    """Yield parts of a group, be sent whether they show what it does, and return the last that did (ddmin, Zeller)."""
    pieces = 2
    while len(group) > 1:
        bounds = [len(group) * number // pieces for number in range(pieces + 1)]
        for first, behind in pairwise(bounds):
            rest = group[:first] + group[behind:]
            if (yield rest):
                group, pieces = rest, max(pieces - 1, 2)
                break
        else:
            if pieces == len(group):
                break
            pieces = min(2 * pieces, len(group))
    return group


def _shown(outcome: Outcome) -> _Shown:
    told = outcome.statistics.get("behaviour") or {}
    return frozenset((name, value) for name, values in told.items() for value in values)
