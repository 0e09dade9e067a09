"""Causes of behaviour that no earlier trial has shown: isolated from the rest of their trial, and built upon.

A fault may need several steps that each show: one message switches the unit into another mode, and another one does
harm in that mode. So if a passing trial shows something new, parts of its group are tried until the variations that
cause it are known; from then on these are part of many trials, with others around them.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from riot_bus.campaign.variations import Placed, Variation

_MOST = 16
"""Most novelties that are pursued: a unit that shows something new each time would give an endless number."""
_MOST_VALUES = 24
"""Values of one name after which further ones, such as of a field that repeats an input, are not new."""
_STEPS, _TOGETHER = 60, 8
"""Most trials to find the variations that cause new behaviour, and most that may cause it together."""
_TIMES = 8
"""Most times that a single variation occurs in a trial that builds upon it: something may follow each time."""

_Shown = frozenset[tuple[str, str]]
_Group = tuple["Placed", ...]


@dataclass(eq=False)
class _Pursuit:
    """The search for the cause of new behaviour.

    Attributes:
        shown: The new behaviour; a part shows it if it shows some of it.
        parts: Generator of parts to try, to which is sent whether they show it.
    """

    shown: _Shown
    parts: Generator[_Group, bool, _Group]
    part: _Group
    steps: int = 0


class Novelties:
    """Choice of variations to try because of new behaviour; equal outcomes in equal order give equal choices.

    Attributes:
        kept: Groups of variations that caused new behaviour, those of several variations on the same messages as then.
    """

    def __init__(self, *, seed: int) -> None:
        self._random = random.Random(f"novelties:{seed}")  # noqa: S311
        self._known: dict[str, set[str]] = {}
        self._open: deque[_Pursuit] = deque()
        self._tried: dict[_Group, _Pursuit] = {}
        self._pursued = 0
        self.kept: list[_Group] = []

    def know(self, outcomes: Iterable[Outcome]) -> None:
        """Record the behaviour of nominal trials."""
        for outcome in outcomes:
            self._new(outcome)

    def learn(self, group: Sequence[Placed], outcome: Outcome) -> None:
        """Record a passing trial of variations that were tried together."""
        new = self._new(outcome)
        if new and group and self._pursued < _MOST:
            self._pursued += 1
            parts = _minimal(tuple(group))
            self._go_on(_Pursuit(new, parts, ()), None)

    def next(self) -> _Group:
        """Return a part of a group, to see whether it shows what the whole one did; nothing if there is none."""
        if not self._open or self._open[0].part in self._tried:  # two pursuits may need the same part
            return ()
        pursuit = self._open.popleft()
        self._tried[pursuit.part] = pursuit
        return pursuit.part

    def record(self, group: _Group, outcome: Outcome) -> None:
        """Record the outcome of a part."""
        passed = outcome.verdict is Verdict.PASS
        self._go_on(pursuit := self._tried.pop(group), passed and bool(pursuit.shown & _shown(outcome)))
        if passed:
            self._new(outcome)

    def seeds(self) -> tuple[list[Variation], _Group]:
        """Return variations to build upon: one on any messages, or several on fixed ones; nothing if there are none."""
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
            self._open.append(pursuit)

    def _new(self, outcome: Outcome) -> _Shown:
        """Return the new behaviour of an outcome, and remember it."""
        new = set()
        for name, value in _shown(outcome):
            known = self._known.setdefault(name, set())
            if value not in known and len(known) < _MOST_VALUES:
                new.add((name, value))
        for name, value in new:
            self._known[name].add(value)
        return frozenset(new)


def _minimal(group: _Group) -> Generator[_Group, bool, _Group]:
    """Yield parts of a group, receive whether they show its behaviour, return the last that did (ddmin, Zeller)."""
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
