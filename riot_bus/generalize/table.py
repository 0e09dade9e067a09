"""The trials so far as a table: samples, outcomes, feature values, and the literals that could separate them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import FLAGS, Feature, features_of
from riot_bus.generalize.literals import LARGEST_SET, Literal, Value
from riot_bus.generalize.numbers import number_bits, simplest, step
from riot_bus.generalize.sampling import Assignment, Variable, columns_of, integer_range, row_of, scalars_of
from riot_bus.vocabulary.message import Scalar


@dataclass(frozen=True, slots=True)
class Candidate:
    """A literal whose threshold is still an interval: `outside` does not satisfy it any more, `inside` does."""

    feature: Feature
    operator: str
    bits: float
    outside: Scalar | None = None
    inside: Value = None

    def between(self, outside: int | float, inside: int | float) -> Candidate:
        """Return the literal with another interval for its threshold."""
        new = replace(self, outside=outside, inside=inside)
        return replace(new, bits=self.bits + new._interval_bits() - self._interval_bits())

    def _interval_bits(self) -> float:
        assert isinstance(self.outside, int | float)
        assert isinstance(self.inside, int | float)
        return _interval_bits(*sorted((float(self.outside), float(self.inside))))


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


class _Offers:
    """Literals that are offered to the learner, and where each holds."""

    def __init__(self, samples: int) -> None:
        self.candidates: list[Candidate] = []
        self._masks: list[Array] = [np.zeros((0, samples), dtype=bool)]

    @property
    def masks(self) -> Array:
        """Where they hold (literals x samples)."""
        return np.vstack(self._masks)

    def add(self, candidate: Candidate, mask: Array) -> None:
        """Offer one literal."""
        self.add_all([candidate], mask[None, :])

    def add_all(self, candidates: Sequence[Candidate], masks: Array) -> None:
        """Offer several; their masks are rows."""
        self.candidates += candidates
        self._masks.append(masks)


class Table:
    """All samples with their features."""

    def __init__(self, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        self._scalars = scalars_of(variables)
        types = {variable.name: variable.type for variable in self._scalars}
        self.features = [*features_of(types), *(feature for each in self._scalars for feature in _beginnings(each))]
        self._types = types
        self.assignments: list[Assignment] = []
        self.rows: list[dict[str, Scalar]] = []
        self.failed: list[bool] = []
        self._values: list[list[Scalar] | None] = [[] for _ in self.features]

    @property
    def columns(self) -> dict[str, Array]:
        """The samples as one array per variable that rules see."""
        return columns_of(self.variables, self.assignments)

    @property
    def outcomes(self) -> Array:
        """Whether each sample failed; shape (samples,)."""
        return np.array(self.failed, dtype=bool)

    def add(self, assignments: Sequence[Assignment], failed: Sequence[bool]) -> None:
        """Append samples with their outcomes."""
        if not assignments:
            return
        columns = columns_of(self.variables, assignments)
        self.assignments.extend(assignments)
        self.rows.extend(row_of(self.variables, assignment) for assignment in assignments)
        self.failed.extend(failed)
        for index, feature in enumerate(self.features):
            known = self._values[index]
            values = feature.values(columns) if known is not None else None
            if values is None or known is None:
                self._values[index] = None
            else:
                known.extend(values.tolist())

    def include(self, features: Sequence[Feature]) -> bool:
        """Add features, for all samples; return whether any is new."""
        new = [feature for feature in dict.fromkeys(features) if feature not in self.features]
        columns = self.columns if new else {}
        for feature in new:
            values = feature.values(columns)
            self.features.append(feature)
            self._values.append(None if values is None else values.tolist())
        return bool(new)

    def values(self, feature: Feature) -> list[Scalar]:
        """Return the values of one feature for all samples."""
        return self._values[self.features.index(feature)] or []

    def candidates(self) -> tuple[list[Candidate], Array]:
        """Return the literals that could separate failing from passing samples, and where each holds (k x samples)."""
        failed = self.outcomes
        offers = _Offers(len(failed))
        if not self.assignments:
            return [], offers.masks
        for feature, values in zip(self.features, self._values, strict=True):
            if feature.kind in FLAGS:
                mask = np.array(values, dtype=bool)
                offers.add(Candidate(feature, "is", feature.cost + 1.0), mask)
                offers.add(Candidate(feature, "not", feature.cost + 2.0), ~mask)
                continue
            if feature.kind in ("sub", "mulsub", "linear") and any(
                type(row) is int and row == 0 for row in values or ()
            ):
                mask, bits = np.array([row == 0 for row in values or ()]), feature.cost + 2.0 + number_bits(0)
                offers.add(Candidate(feature, "==", bits, inside=0), mask)
                offers.add(Candidate(feature, "!=", bits + 2.0, inside=0), ~mask)
            if values is not None and (feature.kind != "raw" or self._ordered(feature)):
                _thresholds(feature, values, failed, offers, self._least(feature))
        for variable in self._scalars:
            rows = [row[variable.name] for row in self.rows]
            if not variable.type.startswith("float"):
                self._categories(variable, rows, failed, offers)
            if variable.type.startswith(("int", "uint")):
                _residues(variable, rows, failed, offers)
        return offers.candidates, offers.masks

    def conditional(self, within: Array) -> tuple[list[Candidate], Array]:
        """Return thresholds that separate failing from passing samples among those of a mask alone.

        A second limit of a rule may not show as a flip among all samples.
        """
        failed = self.outcomes
        offers = _Offers(len(failed))
        for feature, values in zip(self.features, self._values, strict=True):
            if values is not None and feature.kind not in FLAGS and (feature.kind != "raw" or self._ordered(feature)):
                _thresholds(feature, values, failed, offers, self._least(feature), within)
        return offers.candidates, offers.masks

    def _least(self, feature: Feature) -> int | None:
        """Return the least value that a feature of one integer or text can have."""
        limits = integer_range(self._types[feature.args[0]]) if feature.kind == "raw" else None
        return 0 if feature.kind in ("len", "bytes") else None if limits is None else limits[0]

    def _ordered(self, feature: Feature) -> bool:
        return self._types[feature.args[0]] not in ("bool", "string", "bytes")

    def _categories(self, variable: Variable, rows: list[Scalar], failed: Array, offers: _Offers) -> None:
        """Offer each small or known value that was seen failing, and the sets of those that only fail or only pass.

        Literals with "!=" are offered for values that were seen passing, since a receiver may ignore such a value.
        """
        feature = Feature("raw", (variable.name,))
        known = {variable.failing, *variable.passing, *variable.dictionary, *variable.nominal[:64]}
        told = {row for row in rows if row in known or (abs(row) <= _SMALL if isinstance(row, int) else len(row) <= 8)}  # type: ignore[arg-type]
        bad, good = (
            {row for row, fails in zip(rows, failed, strict=True) if fails == side and row in told} for side in (1, 0)
        )
        numbers = {value: number for number, value in enumerate(told)}
        codes = np.array([numbers.get(row, -1) for row in rows])
        for operator, seen in (("==", bad), ("!=", good)):
            for value in sorted(seen)[:64]:
                if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 16 and value not in known:
                    continue
                mask = codes == numbers[value]
                bits = feature.cost + 2.0 + _value_bits(value, variable) + 2.0 * (operator == "!=")
                offers.add(Candidate(feature, operator, bits, inside=value), mask if operator == "==" else ~mask)
        if variable.type in ("string", "bytes"):
            bad, good = bad & known, good & known
        for operator, members in (("in", bad), ("in", bad - good), ("not in", good - bad), ("not in", good)):
            if 2 <= len(members) <= LARGEST_SET and variable.type != "bool":
                ordered = tuple(sorted(members))
                bits = feature.cost + 2.0 + sum(2.0 + 0.5 * _value_bits(value, variable) for value in ordered)
                mask = np.isin(codes, [numbers[value] for value in ordered])
                candidate = Candidate(feature, operator, bits + (operator == "not in"), inside=ordered)
                offers.add(candidate, mask if operator == "in" else ~mask)


_SMALL = 255
"""Members of a set of integers are known values, or at most this large."""


def _value_bits(value: Scalar, variable: Variable) -> float:
    """Return the approximate description length of a value; it is short for nominal texts."""
    if isinstance(value, bool):
        return 3.0
    if isinstance(value, str | bytes):
        return 3.0 if value in variable.nominal or not value else 3.0 + min(2.0 * len(value), 40.0)
    return number_bits(value)


def _beginnings(variable: Variable) -> list[Feature]:
    """Return prefixes of a failing or nominal text, and its characters that are neither letters nor digits."""
    found: dict[Feature, None] = {}
    for text in (variable.failing, *variable.nominal[:1]):
        if not isinstance(text, str | bytes):
            continue
        found.update(
            (Feature("prefix", (variable.name,), text[:size]), None) for size in range(1, 5) if len(text) >= size
        )
        letters = dict.fromkeys(text[place : place + 1] for place in range(min(len(text), 64)))
        odd = [letter for letter in letters if not letter.isalnum()][:4]
        found.update((Feature("contains", (variable.name,), letter), None) for letter in odd)
    return list(found)


_DIVISORS = (*range(2, 17), 20, 24, 25, 30, 32, 50, 60, 64, 100, 128, 256, 360, 512, 1000, 1024, 3600, 4096)
"""Divisors whose residues are tried: small numbers, powers of ten and two, and those of times and angles."""


def _residues(variable: Variable, rows: list[Scalar], failed: Array, offers: _Offers) -> None:
    """Offer the residues and bits that best tell failing from passing samples."""
    limits = integer_range(variable.type)
    assert limits is not None
    array = np.array(rows, dtype=object if limits[1] >= 2**63 else np.int64)
    ranked: list[tuple[float, Candidate, Array]] = []
    for divisor in _DIVISORS:
        rest = (array % divisor).astype(np.int64)
        bad, fine = np.bincount(rest[failed], minlength=divisor), np.bincount(rest[~failed], minlength=divisor)
        score = bad / max(bad.sum(), 1) - fine / max(fine.sum(), 1)
        feature = Feature("mod", (variable.name,), divisor)
        for operator, place in (("==", int(np.argmax(score))), ("!=", int(np.argmin(score)))):
            bits = feature.cost + number_bits(place)
            candidate = Candidate(feature, operator, bits, inside=place)
            ranked.append((abs(score[place]), candidate, (rest == place) == (operator == "==")))
    # The highest bit of an unsigned integer is a threshold, and is offered as one.
    for bit in range(1, limits[1].bit_length() - variable.type.startswith("uint")):
        mask = ((array >> bit) & 1).astype(bool)
        feature = Feature("bits", (variable.name,), 1 << bit)
        gain = mask[failed].mean() - mask[~failed].mean() if 0 < failed.sum() < len(failed) else 0.0
        ranked.append(
            (abs(gain), Candidate(feature, "!=" if gain > 0 else "==", feature.cost, inside=0), mask == (gain > 0))
        )
    ranked.sort(key=lambda one: (-one[0], one[1].bits))
    for _, candidate, mask in ranked[:12]:  # those that a rule needs are among the first
        offers.add(candidate, mask)


def _thresholds(
    feature: Feature,
    values: list[Scalar],
    failed: Array,
    offers: _Offers,
    least: int | None,
    within: Array | None = None,
) -> None:
    """Offer thresholds where the outcome flips along a feature, among all samples or those of a mask."""
    try:
        array = np.array(values, dtype=np.int64 if all(type(value) is int for value in values) else np.float64)
    except OverflowError:
        array = np.array(values, dtype=object)
    good = (array == array).astype(bool)  # NaN belongs to neither side
    good = good if within is None else good & within
    unique, inverse = np.unique(array[good], return_inverse=True)
    if len(unique) < 2:
        return
    bad = np.bincount(inverse[failed[good]], minlength=len(unique))
    fine = np.bincount(inverse[~failed[good]], minlength=len(unique))
    pure = ((bad[1:] == 0) & (bad[:-1] == 0)) | ((fine[1:] == 0) & (fine[:-1] == 0))
    places = np.flatnonzero(~pure)
    most = 24 if within is None else 12
    if len(places) > most:
        gain = np.abs(np.cumsum(bad)[places] / max(bad.sum(), 1) - np.cumsum(fine)[places] / max(fine.sum(), 1))
        best = places[np.argsort(-gain, kind="stable")[: most - 8]]
        places = np.unique(np.concatenate([best, places[:4], places[-4:]]))
    if not len(places):
        return
    lows, highs = unique[places], unique[places + 1]
    with np.errstate(invalid="ignore"):
        above = (array[None, :] >= highs[:, None]).astype(bool)
        below = (array[None, :] <= lows[:, None]).astype(bool)
    for operator, outer, inner, mask in ((">", lows, highs, above), ("<", highs, lows, below)):
        found = []
        for outside, inside in zip(outer.tolist(), inner.tolist(), strict=True):
            bits = feature.cost + _interval_bits(*sorted((float(outside), float(inside))))
            if operator == "<" and inside == least:
                bits += 4.0  # "== 0" says it better
            found.append(Candidate(feature, operator, bits, outside, inside))
        offers.add_all(found, mask)


def _interval_bits(low: float, high: float) -> float:
    """Return about the description length of the simplest number in between (the search ranks thousands)."""
    if low <= 0 <= high:
        return 1.0
    if not (np.isfinite(low) and np.isfinite(high)):
        return 5.0
    if max(abs(low), abs(high)) < 1e16 and abs(high - low) < 1e-3 * max(abs(low), abs(high)):
        return number_bits(simplest(low, high))
    width = abs(high - low) / max(abs(low), abs(high))
    return float(min(3.5 + 3.3 * max(0.0, -np.log10(max(width, 1e-17))), 40.0))
