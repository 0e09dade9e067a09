"""Edges: where the outcome flips when one number leaves a nominal case, and the linear features that follow from them.

With all other variables nominal, `a * x + b * y + ... > c` flips at a distance from nominal that is inversely
proportional to the variable's coefficient: two edges known to a part in a thousand give the ratio of two coefficients.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, islice, product

from riot_bus.generalize.features import Feature
from riot_bus.generalize.numbers import between, simplest
from riot_bus.generalize.oracle import same_scalar
from riot_bus.generalize.sampling import Assignment, Variable, fit, integer_range
from riot_bus.vocabulary.message import Scalar

NARROW = 1e-3
"""Sufficient width of an edge, relative to its distance from nominal: coefficients have few digits."""

_MULTIPLES = range(1, 9)  # a guess: coefficients in code are small whole numbers
_MOST_CHOICES = 16  # all of four variables with edges on both sides


@dataclass(frozen=True, slots=True)
class Flip:
    """The outcome flips between two values of one variable, both beyond nominal on the same side."""

    name: str
    nominal: int | float
    passing: int | float
    failing: int | float

    @property
    def distances(self) -> tuple[float, float]:
        """Signed distances from nominal of the two values, the smaller one first."""
        return float(self.passing) - float(self.nominal), float(self.failing) - float(self.nominal)

    @property
    def narrow(self) -> bool:
        """Whether the edge is narrow enough for coefficients, or as narrow as it can be."""
        near, far = (abs(value) for value in self.distances)
        return far - near <= NARROW * far or between(*sorted((self.passing, self.failing))) is None


def edges_of(
    variables: Sequence[Variable], nominal: Assignment, assignments: Sequence[Assignment], failed: Sequence[bool]
) -> list[Flip]:
    """Return each variable's narrowest edge on each side, from trials that differ from nominal in it alone."""
    alone: dict[str, list[tuple[int | float, bool]]] = {}
    for assignment, fails in zip(assignments, failed, strict=True):
        other = [name for name, value in assignment.items() if not same_scalar(value, nominal[name])]
        if len(other) == 1:
            value = assignment[other[0]]
            if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
                alone.setdefault(other[0], []).append((value, fails))
    found: list[Flip] = []
    for variable in variables:
        start = nominal[variable.name]
        if not isinstance(start, int | float) or isinstance(start, bool) or not math.isfinite(start):
            continue
        for side in (1, -1):
            beyond = [(value, fails) for value, fails in alone.get(variable.name, ()) if (value - start) * side > 0]
            bad = [value for value, fails in beyond if fails]
            if not bad:
                continue
            # Not by distances from nominal: those of 1e-9 and 1e-300 from 10 are equal.
            failing = min(bad, key=lambda value: value * side)
            fine = [value for value, fails in beyond if not fails and value * side < failing * side]
            found.append(Flip(variable.name, start, max(fine, key=lambda value: value * side, default=start), failing))
    return found


def middle_of(edge: Flip, type_: str) -> Scalar | None:
    """Return a value between the two values of an edge, which halves what is not known; None when there is none."""
    low, high = sorted((edge.passing, edge.failing))
    near, far = edge.distances
    distance = (near + far) / 2 if abs(far) <= 2 * abs(near) else math.copysign(math.sqrt(near * far), far)
    middle: int | float | None = None
    if math.isfinite(distance):
        middle = edge.nominal + (distance if isinstance(edge.nominal, float) else round(distance))
    if middle is None or not low < middle < high:
        middle = between(low, high)
    return None if middle is None else fit(middle, type_)


def farther_base(edges: Sequence[Flip], base: Assignment, types: Mapping[str, str]) -> Assignment | None:
    """Return a case that lies farther from edges of integers that are too near for coefficients, if there is one.

    Integers 479 and 480 are 1 in 30 apart for a nominal 450, but 1 in 480 for 0. With edges on both sides, to leave
    one is to near the other.
    """
    moved = dict(base)
    sides = Counter(edge.name for edge in edges)
    for edge in edges:
        if sides[edge.name] > 1:
            continue
        near, far = (abs(value) for value in edge.distances)
        limits = integer_range(types[edge.name])
        if limits is not None and edge.narrow and far - near > NARROW * far:
            side = 1 if edge.failing > edge.nominal else -1
            value = int(edge.failing) - side * math.ceil(1 / NARROW)
            moved[edge.name] = min(max(value, limits[0]), limits[1])
    return None if all(same_scalar(moved[name], base[name]) for name in moved) else moved


def linear_features(edges: Sequence[Flip]) -> list[Feature]:
    """Return the linear features of two to four variables that fit their edges, with the simplest coefficients."""
    best: dict[str, list[Flip]] = {}
    for edge in edges:
        if edge.narrow and min(abs(distance) for distance in edge.distances) > 0:
            best.setdefault(edge.name, []).append(edge)
    found: dict[Feature, None] = {}
    for size in range(2, 5):
        for names in combinations(best, size):
            for edges_chosen in islice(product(*(best[name] for name in names)), _MOST_CHOICES):
                feature = _linear({edge.name: edge for edge in edges_chosen})
                if feature is not None:
                    found[feature] = None
    return list(found)


def _linear(edges: Mapping[str, Flip]) -> Feature | None:
    """Return the feature whose coefficients are the inverse of the distances, None when no simple ones fit.

    Coefficients of more than four digits are chance.
    """
    furthest = max(edges.values(), key=lambda edge: abs(edge.distances[1]))
    bounds: dict[str, tuple[float, float, int]] = {}
    for name, edge in edges.items():
        near, far = (abs(distance) for distance in edge.distances)
        most, least = abs(furthest.distances[1]) / near, abs(furthest.distances[0]) / far
        least, most = (1.0, 1.0) if edge is furthest else (least, most)
        bounds[name] = (least, most, 1 if edge.distances[1] > 0 else -1)
    for multiple in _MULTIPLES:
        weights: dict[str, int | float] = {}
        for name, (least, most, sign) in bounds.items():
            low, high = math.ceil(least * multiple - 1e-9), math.floor(most * multiple + 1e-9)
            if low > high or low < 1:
                break
            weights[name] = sign * int(simplest(low, high))
        if len(weights) == len(bounds) and all(_digits(weight) <= 4 for weight in weights.values()):
            return _ordered(weights)
    return None


def _digits(weight: int | float) -> int:
    return len(str(abs(Fraction(weight).numerator)).rstrip("0"))


def _ordered(weights: Mapping[str, int | float]) -> Feature | None:
    """Return the feature as people write it: added parts first, larger coefficients first."""
    if all(abs(weight) == 1 for weight in weights.values()) and len(weights) == 2:
        return None  # sums and differences are features anyway
    plus = sum(weight > 0 for weight in weights.values())
    turn = -1 if 2 * plus < len(weights) else 1
    names = sorted(weights, key=lambda name: (turn * weights[name] < 0, -abs(weights[name])))
    if turn * weights[names[0]] < 0:
        return None
    return Feature("linear", tuple(names), tuple(turn * weights[name] for name in names))
