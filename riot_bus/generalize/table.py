"""The trials so far as a table: samples, outcomes, feature values, and the literals that could separate them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from riot_bus.generalize.features import FLAGS, Array, Feature, features_of
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.numbers import number_bits, simplest, step
from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.sampling import Assignment, Variable, columns_of
from riot_bus.vocabulary.trial import Scalar

__all__ = ["Candidate", "Table", "concrete"]

BOUNDARIES = 24
"""So many thresholds per feature are tried."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A literal whose threshold is still an interval: `outside` does not satisfy it any more, `inside` does."""

    feature: Feature
    operator: str
    bits: float
    outside: Scalar | None = None
    inside: Scalar | None = None


def concrete(candidate: Candidate) -> Literal:
    """Return the literal with the simplest threshold of the interval."""
    operator, outside, inside = candidate.operator, candidate.outside, candidate.inside
    if operator not in ("<", ">"):
        return Literal(candidate.feature, operator, inside)
    assert isinstance(outside, int | float)
    assert isinstance(inside, int | float)
    up = operator == ">"
    # Strict: the threshold may be `outside` itself, but not `inside`; the other way round with "or equal".
    nearer, further = step(inside, -1 if up else 1), step(outside, 1 if up else -1)
    strict = simplest(*sorted((outside, nearer)))
    equal = simplest(*sorted((further, inside)))
    shorter = number_bits(equal) + 1.0 < number_bits(strict) and math.isfinite(equal)
    if shorter or not math.isfinite(strict):
        return Literal(candidate.feature, operator + "=", equal)
    return Literal(candidate.feature, operator, strict)


class Table:
    """All samples with their features.

    Args:
        variables: The variables of the rule.
    """

    def __init__(self, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        types = {variable.name: variable.type for variable in variables}
        self.features = features_of(types)
        self._types = types
        self.assignments: list[Assignment] = []
        self.failed: list[bool] = []
        self._values: list[list[Scalar] | None] = [[] for _ in self.features]

    def add(self, assignments: Sequence[Assignment], failed: Sequence[bool]) -> None:
        """Append samples with their outcomes."""
        if not assignments:
            return
        columns = columns_of(self.variables, assignments)
        self.assignments.extend(assignments)
        self.failed.extend(failed)
        for index, feature in enumerate(self.features):
            known = self._values[index]
            values = feature.values(columns) if known is not None else None
            if values is None or known is None:
                self._values[index] = None
            else:
                known.extend(values.tolist())

    def values(self, feature: Feature) -> list[Scalar]:
        """Return the values of one feature for all samples."""
        return self._values[self.features.index(feature)] or []

    def candidates(self) -> tuple[list[Candidate], Array]:
        """Return the literals that could separate failing from passing samples, and where they hold.

        Returns:
            k candidates and a boolean array (k, samples).
        """
        failed = np.array(self.failed, dtype=bool)
        found: list[Candidate] = []
        masks: list[Array] = []
        for feature, values in zip(self.features, self._values, strict=True):
            if feature.kind in FLAGS:
                _flags(feature, np.array(values, dtype=bool), found, masks)
                continue
            if feature.kind in ("raw", "sub"):
                self._equalities(feature, failed, found, masks)
            if values is not None and self._ordered(feature):
                _thresholds(feature, values, failed, found, masks)
        if not masks:
            return [], np.zeros((0, len(failed)), dtype=bool)
        return found, np.vstack(masks)

    def _ordered(self, feature: Feature) -> bool:
        return self._types[feature.args[0]] not in ("bool", "string", "bytes")

    def _equalities(self, feature: Feature, failed: Array, found: list[Candidate], masks: list[Array]) -> None:
        """Categories have one per value seen; integers one per small or known value seen failing.

        That an integer is *not* a value is worth telling if it was seen passing with it: a receiver ignores such.
        """
        rows: list[Scalar]
        bad: set[Scalar]
        good: set[Scalar]
        if feature.kind == "sub":
            rows = self.values(feature)
            bad = good = {0} if any(type(row) is int and row == 0 for row in rows) else set()
        else:
            name = feature.args[0]
            rows = [assignment[name] for assignment in self.assignments]
            variable = next(variable for variable in self.variables if variable.name == name)
            if variable.type.startswith("float"):
                return
            category = not self._ordered(feature)
            known = {variable.failing, *variable.dictionary, *variable.nominal[:64]}
            told = {row for row in rows if category or row in known or (isinstance(row, int) and abs(row) <= 16)}
            bad, good = (
                told & {row for row, fails in zip(rows, failed, strict=True) if fails == side} for side in (1, 0)
            )
        for operator, seen in (("==", bad), ("!=", good)):
            for value in sorted(seen, key=repr)[:64]:
                mask = np.array([same_scalar(row, value) for row in rows], dtype=bool)
                bits = feature.cost + 2.0 + (3.0 if isinstance(value, bool | str | bytes) else number_bits(value))
                found.append(Candidate(feature, operator, bits + 2.0 * (operator == "!="), inside=value))
                masks.append((mask if operator == "==" else ~mask)[None, :])


def _flags(feature: Feature, mask: Array, found: list[Candidate], masks: list[Array]) -> None:
    found.extend((Candidate(feature, "is", feature.cost + 1.0), Candidate(feature, "not", feature.cost + 2.0)))
    masks.extend((mask[None, :], ~mask[None, :]))


def _thresholds(
    feature: Feature, values: list[Scalar], failed: Array, found: list[Candidate], masks: list[Array]
) -> None:
    try:
        array = np.array(values, dtype=np.int64 if all(type(value) is int for value in values) else np.float64)
    except OverflowError:
        array = np.array(values, dtype=object)
    good = array == array  # NaN belongs to neither side
    good = good.astype(bool)
    unique, inverse = np.unique(array[good], return_inverse=True)
    if len(unique) < 2:
        return
    bad = np.bincount(inverse[failed[good]], minlength=len(unique))
    fine = np.bincount(inverse[~failed[good]], minlength=len(unique))
    pure = ((bad[1:] == 0) & (bad[:-1] == 0)) | ((fine[1:] == 0) & (fine[:-1] == 0))
    places = np.flatnonzero(~pure)
    if len(places) > BOUNDARIES:
        gain = np.abs(np.cumsum(bad)[places] / max(bad.sum(), 1) - np.cumsum(fine)[places] / max(fine.sum(), 1))
        best = places[np.argsort(-gain, kind="stable")[: BOUNDARIES - 8]]
        places = np.unique(np.concatenate([best, places[:4], places[-4:]]))
    if not len(places):
        return
    ranks = np.full(len(array), -1)
    ranks[good] = inverse
    above = ranks[None, :] > places[:, None]
    below = (ranks[None, :] <= places[:, None]) & good[None, :]
    uppers = unique.tolist()
    for place in places.tolist():
        low, high = uppers[place], uppers[place + 1]
        bits = feature.cost + _interval_bits(float(low), float(high))
        found.append(Candidate(feature, ">", bits, low, high))
    for place in places.tolist():
        low, high = uppers[place], uppers[place + 1]
        bits = feature.cost + _interval_bits(float(low), float(high))
        found.append(Candidate(feature, "<", bits, high, low))
    masks.extend((above, below))


def _interval_bits(low: float, high: float) -> float:
    """Return about the description length of the simplest number between (the search ranks thousands of them)."""
    if low <= 0 <= high:
        return 1.0
    if not (np.isfinite(low) and np.isfinite(high)):
        return 5.0
    if max(abs(low), abs(high)) < 1e16 and abs(high - low) < 1e-3 * max(abs(low), abs(high)):
        return number_bits(simplest(low, high))
    width = abs(high - low) / max(abs(low), abs(high))
    return float(min(3.5 + 3.3 * max(0.0, -np.log10(max(width, 1e-17))), 40.0))
