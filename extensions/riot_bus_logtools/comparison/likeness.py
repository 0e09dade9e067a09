"""Similarity of messages as numbers, which an alignment needs for many pairs at once.

Only the few fields that vary most are used; each text is represented by a number. The alignment only pairs messages:
the pairs that it finds are then compared in all their fields.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from riot_bus_logtools.comparison.fields import Reading, Value
    from riot_bus_logtools.comparison.tolerances import Tolerance

MOST_FIELDS = 32
_LEAST = 0.01
"""Most that the distance of a pair adds to its cost: it breaks ties, and never outweighs a message."""
_FAR = 1e300
"""Two values are only farther apart than this if one of them is one of these."""
_MISSING, _NAN, _INFINITE = _FAR * -9, _FAR * 9, _FAR * 3


def most_varied(sample: Sequence[Reading]) -> dict[str, Tolerance]:
    """Return the compared fields that vary most among some messages, with their tolerances."""
    values: dict[str, set[Value]] = {}
    rules: dict[str, Tolerance] = {}
    counts: Counter[str] = Counter()
    for reading in sample:
        shape = reading.shape
        for place in shape.compared:
            path = shape.paths[place]
            values.setdefault(path, set()).add(reading.values[place])
            rules[path] = shape.rules[place]
            counts[path] += 1
    varied = {path: len(found) + (counts[path] < len(sample)) for path, found in values.items()}
    chosen = sorted((path for path, number in varied.items() if number > 1), key=lambda path: -varied[path])
    return {path: rules[path] for path in chosen[:MOST_FIELDS]}


def as_numbers(readings: Iterable[Reading], paths: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return fields of messages as numbers, shape (messages, fields), and which fields are not numbers."""
    rows: list[NDArray[np.float64]] = []
    texts = np.zeros(len(paths), np.bool_)
    for reading in readings:
        there, row = reading.shape.place, np.full(len(paths), _MISSING)
        for column, path in enumerate(paths):
            at = there.get(path)
            if at is not None:
                row[column], text = _as_number(reading.values[at])
                texts[column] |= text
        rows.append(row)
    return np.stack(rows) if rows else np.zeros((0, len(paths))), texts


class Likeness:
    """The cost of pairs of messages, for `riot_bus_logtools.comparison.band`.

    Args:
        a: Numbers of messages of one log, shape (messages, fields).
        b: Numbers of messages of the other log, shape (messages, fields).
    """

    def __init__(
        self,
        a: NDArray[np.float64],
        b: NDArray[np.float64],
        *,
        texts: NDArray[np.bool_],
        rules: Mapping[str, Tolerance],
    ) -> None:
        self._a, self._b, self._texts = a, b, texts
        self._absolute = np.array([each.absolute for each in rules.values()])
        self._relative = np.array([each.relative for each in rules.values()])
        self._scale = np.array([_scale(column) for column in np.abs(np.diff(a, axis=0)).T])

    def costs(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the costs of pairs, by the positions of their messages in both logs."""
        if not len(self._scale):
            return np.zeros(np.broadcast_shapes(rows.shape, columns.shape))
        left, right = self._a[rows], self._b[columns]
        apart = np.abs(left - right)
        allowed = np.maximum(self._absolute, self._relative * np.maximum(np.abs(left), np.abs(right)))
        differs = apart > np.where(self._texts | (apart > _FAR), 0.0, allowed)
        distance = np.where(self._texts, differs, apart / (apart + self._scale))
        found: NDArray[np.float64] = differs.any(axis=-1) + _LEAST * distance.mean(axis=-1)
        return found


def _as_number(value: Any) -> tuple[float, bool]:
    if value.__class__ is float or value.__class__ is int:
        return max(-_INFINITE, min(_INFINITE, float(value))), False
    if getattr(value, "value", None).__class__ is float:
        return _NAN, False
    return float(hash(value) & 0xFFFFFFFFFFFF), True


def _scale(steps: NDArray[np.float64]) -> float:
    """Return how much a field typically changes from one message to the next."""
    moved = steps[(steps > 0) & (steps < _FAR)]
    return float(np.median(moved)) if len(moved) else 1.0
