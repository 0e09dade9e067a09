"""Counts what differs between the messages of a topic, field by field."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from statistics import median
from typing import TYPE_CHECKING, TypeGuard

from riot_bus_logtools.comparison.parts import FieldDifference, FieldExample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.vocabulary.message import Scalar
    from riot_bus_logtools.comparison.fields import FieldChange

MOST_FIELDS = 10_000
"""Most fields of a topic that are counted separately; differences in others are counted together."""

_OTHERS = "(other fields)"
_LONGEST = 200  # two values for each of MOST_FIELDS fields: 8 million characters, if hexadecimal
_SAMPLE = 4096  # distances, of which half are kept: the median's rank is exact to about 1 %


@dataclass(slots=True)
class _Field:
    messages: int = 0
    example: FieldExample | None = None
    largest: float = -1.0
    low: float = math.inf
    high: float = -math.inf
    whole: bool = True
    unlike: int = 0
    distances: array[float] = field(default_factory=lambda: array("d"))
    every: int = 1
    rises: bool | None = None
    pairs: int = -1
    turns: int = 0

    def take(self, change: FieldChange, a: int, b: int, seconds: float) -> None:
        """Add a change; `messages` is counted elsewhere, since a message may have several changes of one name."""
        distance = 0.0
        both = [value for value in (change.before, change.after) if _is_number(value)]
        if len(both) == 2:
            finite = [float(value) for value in both if math.isfinite(value)]
            distance = abs(both[0] - both[1]) if len(finite) == 2 else math.inf
            self.whole = self.whole and all(isinstance(value, int) for value in both)
            self.low, self.high = min([self.low, *finite]), max([self.high, *finite])
            if self.messages % self.every == 0:  # of `every` messages, the distance of one is kept
                self.distances.append(distance)
                if len(self.distances) >= _SAMPLE:
                    self.distances, self.every = self.distances[::2], self.every * 2
            rises = both[1] > both[0]
            self.pairs, self.turns = self.pairs + 1, self.turns + (self.rises is not None and rises != self.rises)
            self.rises = rises
        else:
            self.unlike += 1
        if distance > self.largest:
            self.largest = distance
            self.example = FieldExample(change.path, a, b, seconds, _short(change.before), _short(change.after))

    def result(self, name: str) -> FieldDifference:
        """Return what was counted."""
        assert self.example is not None
        if self.unlike and not self.distances:
            return FieldDifference(name, self.messages, self.example, unlike=self.unlike)
        low, high = (self.low, self.high) if self.low <= self.high else (None, None)
        return FieldDifference(
            name,
            self.messages,
            self.example,
            self.largest,
            median(self.distances),
            low,
            high,
            self.whole,
            self.unlike,
            self.turns / self.pairs if self.pairs > 0 else 0.0,
        )


class Tally:
    """Counts of the differences in the pairs of messages of a topic; `near` ones are within the tolerances.

    In `left` are the fields that are not compared, in `same_fields` messages of other bytes, but the same fields.
    """

    def __init__(self) -> None:
        self.near = self.changed = self.same_fields = 0
        self.left: dict[str, int] = {}
        self.changed_at: array[int] = array("q")
        self._fields: dict[str, _Field] = {}

    def take(self, changes: Sequence[FieldChange], a: int, b: int, seconds: float) -> None:
        """Add a pair of messages whose bytes differ: changes, numbers in both logs, seconds in the first one."""
        if not changes:
            self.same_fields += 1
            return
        for name in {each.name for each in changes if each.rule.leave}:
            self.left[name] = self.left.get(name, 0) + 1
        changed = [each for each in changes if not each.allowed]
        if changed:
            self.changed += 1
            self.changed_at.append(a)
        self.near += not changed and any(not each.rule.leave for each in changes)
        names = set()
        for each in changed:
            name = each.name if each.name in self._fields or len(self._fields) < MOST_FIELDS else _OTHERS
            found = self._fields.setdefault(name, _Field())
            found.take(each, a, b, seconds)
            names.add(name)
        for name in names:
            self._fields[name].messages += 1

    def fields(self) -> tuple[FieldDifference, ...]:
        """Return the fields that differ, those in most messages first."""
        found = [each.result(name) for name, each in self._fields.items()]
        return tuple(sorted(found, key=lambda each: (-each.messages, each.name)))


def _is_number(value: Scalar | None) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Scalar | None) -> Scalar | None:
    """Return a value, shortened if it is long text or bytes."""
    if isinstance(value, str | bytes) and len(value) > _LONGEST:
        rest = f"... ({len(value)} {'bytes' if isinstance(value, bytes) else 'characters'})"
        return (value[:_LONGEST].hex() if isinstance(value, bytes) else value[:_LONGEST]) + rest
    return value
