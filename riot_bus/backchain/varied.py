"""Inputs that vary in time, as numbers that a search can set (RIOT II-D)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.fir import Floats

_PARTS = 3
"""Parts of a run: enough for a pulse that another value follows."""
_WAVE_POINTS, _MOST_PERIODS = 16, 40  # a guess: points of a period, and periods in a run


class Dimension(NamedTuple):
    """One number of an input that varies in time.

    Attributes:
        field: Index of the field whose value it is; None for a time.
    """

    search: SearchField
    field: int | None


@dataclass(frozen=True, slots=True)
class Drive:
    """Values of one field during a part of a run.

    Attributes:
        value: Value that it is set to; None if there are `points`.
        start: Start of that time, in seconds since the first message.
        end: End of that time, in seconds; None for never.
        message: Number of the only message that gets the value; None for all in that time.
        points: Times in seconds and values, with straight lines between them, instead of one value.
        how: Text on when it has the value, or how it moves; empty for a value in the whole run.
    """

    field: str
    value: float | None
    start: float = 0.0
    end: float | None = None
    message: int | None = None
    points: tuple[tuple[float, float], ...] = ()
    how: str = ""


class VariedInputs:
    """Ways in which fields vary in time: piecewise constant, along lines, as waves, and in one message alone.

    A field that would get its nominal value is left alone.

    Args:
        counts: Number of messages of each field's topic in a run; 0 for a field with one value per run.

    Attributes:
        field_of: Field of each number that is a value; numbers that are times have none.
    """

    def __init__(self, fields: Sequence[SearchField], seconds: float, counts: Sequence[int]) -> None:
        self._fields = tuple(fields)
        self._seconds = seconds
        self._counts = tuple(counts)
        parts = [one for part in range(1, _PARTS + 1) for one in self._values(f"[part {part}]")]
        ends = [_time(f"[end of part {part}]", seconds, part / _PARTS) for part in range(1, _PARTS)]
        lines = [one for point in range(1, _PARTS + 1) for one in self._values(f"[point {point}]") if self._moves(one)]
        moving = [one for one in self._values("[amplitude]") if self._moves(one)]
        waves = [
            Dimension(replace(one, nominal=0.0, low=one.low - one.nominal, high=one.high - one.nominal), place)
            for one, place in moving
        ]
        period = SearchField("[period]", seconds / 5, seconds / 20, seconds / _MOST_PERIODS, seconds)
        alone, place = self._values("[one message]"), _time("[place of the message]", 1.0, 0.5)
        none: list[SearchField] = []
        ways = ((parts, ends), (lines, none), (waves, [period]), (alone, [place]))
        still = [Dimension(self._fields[place], place) for place, count in enumerate(self._counts) if not count]
        self.families: tuple[tuple[Dimension, ...], ...] = tuple(
            (*values, *(Dimension(time, None) for time in times), *still) for values, times in ways if values
        )
        self.field_of = {field.name: field.name for field in fields} | {
            each.search.name: self._fields[each.field].name
            for family in self.families
            for each in family
            if each.field is not None
        }

    def _values(self, suffix: str) -> list[Dimension]:
        return [
            Dimension(replace(field, name=f"{field.name} {suffix}"), place)
            for place, field in enumerate(self._fields)
            if self._counts[place]
        ]

    def _moves(self, dimension: Dimension) -> bool:
        """Return whether a field can go from one value to another through those between."""
        return dimension.field is not None and not self._fields[dimension.field].choice

    def drives(self, point: Mapping[str, float]) -> list[Drive]:
        """Return the drives of the fields at a point; a field's own name stands for a value in the whole run."""
        found: list[Drive] = []
        for field, count in zip(self._fields, self._counts, strict=True):
            if field.name in point:
                found.append(Drive(field.name, point[field.name]))
            found += self._parts(field, point)
            found += self._lines(field, point)
            found += self._wave(field, point)
            value = point.get(f"{field.name} [one message]", field.usual)
            if value != field.usual:
                number = round(point["[place of the message]"] * max(0, count - 1))
                found.append(Drive(field.name, value, message=number, how=f"in message {number + 1} of its topic"))
        return found

    def _parts(self, field: SearchField, point: Mapping[str, float]) -> Iterator[Drive]:
        ends = sorted(point.get(f"[end of part {part}]", self._seconds) for part in range(1, _PARTS))
        for part, (start, end) in enumerate(pairwise([0.0, *ends, math.inf]), start=1):
            value = point.get(f"{field.name} [part {part}]", field.usual)
            if value != field.usual and start < end:
                last = math.isinf(end)
                how = f"from {start:.3g} s on" if last else f"from {start:.3g} to {end:.3g} s"
                yield Drive(field.name, value, start, None if last else end, how=how)

    def _lines(self, field: SearchField, point: Mapping[str, float]) -> Iterator[Drive]:
        values = [point.get(f"{field.name} [point {number}]", field.usual) for number in range(1, _PARTS + 1)]
        if any(value != field.usual for value in values):
            points = tuple(zip(np.linspace(0.0, self._seconds, _PARTS).tolist(), values, strict=True))
            how = "along lines: " + ", ".join(f"{value:g} at {time:.3g} s" for time, value in points)
            yield Drive(field.name, None, points=points, how=how)

    def _wave(self, field: SearchField, point: Mapping[str, float]) -> Iterator[Drive]:
        if amplitude := point.get(f"{field.name} [amplitude]", 0.0):
            period = point["[period]"]
            times = np.arange(0.0, self._seconds + period / _WAVE_POINTS, period / _WAVE_POINTS).tolist()
            values = (field.usual + amplitude * math.sin(2 * math.pi * time / period) for time in times)
            points = tuple(
                (at, min(max(value, field.low), field.high)) for at, value in zip(times, values, strict=True)
            )
            how = f"a wave of {abs(amplitude):g} around {field.usual:g} with a period of {period:.3g} s"
            yield Drive(field.name, None, points=points, how=how)


def _time(name: str, seconds: float, share: float) -> SearchField:
    return SearchField(name, share * seconds, seconds, 0.0, seconds)


class Recombination:
    """Proposals for several fields at once, of values that were tried for each alone and the ends of the ranges.

    This leads off a plateau on which a field matters only while, or after, another one has a certain value.

    Args:
        constants: Vectors that were tried, in [0, 1]^n, one number for each field, the best first.
    """

    def __init__(self, family: Sequence[Dimension], constants: Sequence[Floats], rng: np.random.Generator) -> None:
        self._family = family
        self._usual = Encoding(tuple(each.search for each in family)).nominal
        self._rng = rng
        tried = np.asarray(constants)
        self._pool = [
            np.concatenate([tried[:6, field], np.quantile(tried[:, field], (0.0, 0.25, 0.75, 1.0))])
            for field in range(tried.shape[1])
        ]

    def ask(self) -> Floats:
        """Return a vector in which each value is the usual one or one of these; times are random."""
        rng, vector = self._rng, self._usual.copy()
        share, ends = rng.uniform(0.2, 0.8), rng.random() < 0.5
        for place, (_, field) in enumerate(self._family):
            if field is None:
                vector[place] = rng.random()
            elif rng.random() < share:
                vector[place] = rng.choice((0.0, 1.0) if ends else self._pool[field])
        return vector

    def tell(self, vector: Floats, value: float) -> None:
        """Do nothing: no proposal depends on an answer."""
