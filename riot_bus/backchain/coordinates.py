"""Search along one field at a time: a step each way, then to where a straight line predicts that the rule is met."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from riot_bus.backchain.encoding import Encoding
from riot_bus.backchain.fir import Floats

_REACHES = (0.2, 0.35, 0.07)
"""Steps, as shares of a field's encoded range; the next one only if no field comes nearer with the previous one."""
_FEW = 4
"""Number of other values that are tried for a field with few values."""
_NEARER = 0.95
"""A distance below this share of another one is progress, not noise."""
_LINES, _STEPS, _ROUNDS = 4, 6, 4
"""Fields that are followed from one point, runs along each, and points from which the search starts."""


@dataclass(slots=True)
class _Line:
    """Values and distances known along one field, the latest last; `bad` is a value that came no nearer."""

    field: int
    known: list[tuple[float, float]]
    bad: float | None = None
    steps: int = 0
    refined: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """A proposed vector: a step of one field, a value along a line, or neither."""

    vector: Floats
    step: int | None = None
    line: _Line | None = None
    value: float = math.nan


class CoordinateSearch:
    """Search that moves fields one at a time from the best point, as long as the distance to the rule shrinks.

    Distances are often linear in a field's own value, at least over some range; then two answers predict where the rule
    is met. If inputs are refused or come no nearer, half of the way is tried.
    """

    def __init__(self, encoding: Encoding) -> None:
        self._encoding = encoding
        self._base = encoding.nominal
        self._base_distance: float | None = None
        self._best: tuple[float, Floats] = (math.inf, self._base)
        self._queue = deque([_Asked(self._base)])
        self._out: list[_Asked] = []
        self._answers: list[tuple[_Asked, float]] = []
        self._reach = self._round = 0
        self._lines: list[_Line] = []

    def ask(self) -> Floats | None:
        """Return the next vector; None while answers are pending, and when the search is over."""
        if not self._queue:
            return None
        self._out.append(self._queue.popleft())
        return self._out[-1].vector

    def tell(self, vector: Floats, value: float) -> None:
        """Take the answer to a vector that was asked for; smaller is better."""
        asked = next(each for each in self._out if each.vector is vector)
        self._out = [each for each in self._out if each is not asked]
        self._answers.append((asked, value))
        if value < self._best[0]:
            self._best = value, vector
        if not self._out and not self._queue:
            self._go_on()

    def _go_on(self) -> None:
        """Queue the next vectors, once all answers of a stage are there."""
        answers, self._answers = self._answers, []
        if self._base_distance is None:
            self._begin_round(answers[0][1])
        elif not self._lines:
            self._follow(answers)
        else:
            self._along(answers)

    def _begin_round(self, distance: float) -> None:
        self._base_distance = distance
        self._reach, self._lines = 0, []
        self._queue.extend(self._star())

    def _star(self) -> Iterator[_Asked]:
        for place, search in enumerate(self._encoding.fields):
            if search.few:
                count = min(_FEW + 1, round(search.high - search.low) + 1)
                values = [search.sensible(value) for value in np.linspace(search.low, search.high, count)]
                shares = [self._share(place, value) for value in dict.fromkeys(values)] if not self._reach else []
            else:
                reach = _REACHES[self._reach]
                shares = [min(max(self._base[place] + sign * reach, 0.0), 1.0) for sign in (-1, 1)]
            for share in shares:
                if self._value(place, share) != self._value(place, self._base[place]):
                    yield _Asked(self._moved({place: share}), step=place)

    def _follow(self, answers: list[tuple[_Asked, float]]) -> None:
        """Choose the fields that come nearer; if there are none, queue wider or smaller steps."""
        assert self._base_distance is not None
        best: dict[int, tuple[float, float]] = {}
        for asked, distance in answers:
            place = asked.step
            if place is not None and distance < _NEARER * self._base_distance:
                best[place] = min(best.get(place, (math.inf, 0.0)), (distance, self._value(place, asked.vector[place])))
        if not best:
            self._reach += 1
            if self._reach < len(_REACHES):
                self._queue.extend(self._star())
            return
        for place, (distance, value) in sorted(best.items(), key=lambda each: each[1])[:_LINES]:
            start = self._value(place, self._base[place]), self._base_distance
            self._lines.append(_Line(place, [start, (value, distance)]))
        self._queue.extend(following for line in self._lines if (following := self._next(line)))
        if not self._queue:
            self._along([])

    def _along(self, answers: list[tuple[_Asked, float]]) -> None:
        """Continue along each line; when all have ended, combine their best values and start from the best point."""
        for asked, distance in answers:
            line = asked.line
            if line is None:
                continue
            if distance < line.known[-1][1]:
                line.known.append((asked.value, distance))
            elif line.bad is not None and distance * _NEARER <= line.known[-1][1]:
                line.known.append((asked.value, distance))  # from here on, another field decides
                line.steps = _STEPS
            else:
                line.bad = asked.value
            if following := self._next(line):
                self._queue.append(following)
        if self._queue:
            return
        ends = self._moved({line.field: self._share(line.field, line.known[-1][0]) for line in self._lines})
        reached = self._lines[0].known[-1][1]
        if len(self._lines) > 1:
            if not answers or answers[0][0].line is not None:
                self._queue.append(_Asked(ends))
                return
            reached = answers[0][1]
        assert self._base_distance is not None
        self._round += 1
        distance, vector = self._best
        if self._round < _ROUNDS and distance < _NEARER * self._base_distance:
            self._base, distance = (ends, reached) if reached * _NEARER <= distance else (vector, distance)
            self._begin_round(distance)

    def _next(self, line: _Line) -> _Asked | None:
        """Return the next vector along a line; None at its end."""
        (before, far), (value, near) = line.known[-2:]
        line.steps += 1
        if line.steps > _STEPS or near <= 0:
            return None
        ahead = min(near / (far - near), 20.0) if far > near else 0.0
        met = value + ahead * (value - before)
        if line.bad is None:
            following = met + 0.05 * (met - value)  # a little beyond
        elif not line.refined and ahead and abs(met - value) < abs(line.bad - value):
            line.refined = True
            following = met + (line.bad - met) / 4
        else:
            following = (value + line.bad) / 2
        search = self._encoding.fields[line.field]
        following = search.sensible(following)
        if following in (value, line.bad):
            return None
        vector = self._moved({line.field: self._share(line.field, following)})
        return _Asked(vector, line=line, value=self._value(line.field, vector[line.field]))

    def _moved(self, shares: Mapping[int, float]) -> Floats:
        vector = self._base.copy()
        for place, share in shares.items():
            vector[place] = share
        return vector

    def _share(self, place: int, value: float) -> float:
        search = self._encoding.fields[place]
        low, high = search.ends
        return min(max((search.encode(value) - low) / (high - low), 0.0), 1.0)

    def _value(self, place: int, share: float) -> float:
        search = self._encoding.fields[place]
        low, high = search.ends
        return search.decode(low + share * (high - low))
