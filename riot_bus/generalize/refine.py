"""Trials that put one feature between two known values and leave the rest of a rule as it is."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.features import Feature
from riot_bus.generalize.numbers import between, number_bits, step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import Assignment, columns_of, fit
from riot_bus.generalize.table import Candidate, Table, concrete

__all__ = ["probe_threshold", "widen"]

Number = int | float


def widen(table: Table, learnt: Learnt) -> Learnt:
    """Return the rule with each threshold's interval between the samples that this literal alone decides about.

    The learner's interval may end at a sample that passes for another reason (the rest of the term does not hold).
    """
    columns = columns_of(table.variables, table.assignments)
    failed = np.array(table.failed, dtype=bool)
    terms = [list(term) for term in learnt.terms]
    for row, term in enumerate(terms):
        other_terms = Rule(tuple(tuple(map(concrete, term)) for index, term in enumerate(terms) if index != row))
        elsewhere = other_terms.predict(columns)
        for place, candidate in enumerate(term):
            if candidate.operator not in ("<", ">"):
                continue
            rest = Rule((tuple(concrete(other) for index, other in enumerate(term) if index != place),)).predict(
                columns
            )
            holds = concrete(candidate).holds(columns)
            values = candidate.feature.values(columns)
            assert values is not None  # only numbers have thresholds
            inner = values[rest & failed & holds & ~elsewhere].tolist()
            outer = values[rest & ~failed & ~holds].tolist()
            outer = [value for value in outer if value == value]  # without NaN
            if inner and outer:
                inside, outside = (min(inner), max(outer)) if candidate.operator == ">" else (max(inner), min(outer))
                term[place] = replace(candidate, outside=outside, inside=inside)
    return replace(learnt, terms=tuple(tuple(term) for term in terms))


def probe_threshold(
    table: Table, learnt: Learnt, place: tuple[int, int], chance: random.Random, *, turn: int
) -> Assignment | None:
    """Return a trial that narrows the threshold of one literal, None when it is as exact as trials can make it.

    Takes turns between halving the interval and testing the simplest number in it from both sides.

    Args:
        table: The trials so far.
        learnt: The rule.
        place: Index of the term, and of the literal in it.
        chance: Source of randomness.
        turn: Number of probes of this literal so far.
    """
    candidate = learnt.terms[place[0]][place[1]]
    low, high = candidate.outside, candidate.inside
    if not isinstance(low, int | float) or not isinstance(high, int | float) or candidate.operator not in "<>":
        return None
    low, high = min(low, high), max(low, high)
    middle = between(low, high)
    if middle is None:
        return None
    targets = [middle]
    tight = (low > 0 and high < 16 * low) or (high < 0 and low > 16 * high) or low <= 0 <= high
    if tight and turn % 3 != 2:
        targets = _around(candidate, low, high) + targets
    options = _solutions(table, learnt, place, targets, chance)
    if not options:
        return None
    columns = columns_of(table.variables, options)
    values = candidate.feature.values(columns)
    assert values is not None  # only numbers have thresholds
    free = _only(learnt, place).predict(columns)
    reached = [
        (value, option)
        for value, option, ok in zip(values.tolist(), options, free, strict=True)
        if ok and low < value < high
    ]
    for target in targets:
        exact = [option for value, option in reached if value == target]
        if exact:
            return exact[0]
    if not reached:
        return None
    goal = _scale(middle)
    return min(reached, key=lambda pair: abs(_scale(pair[0]) - goal))[1]


def _around(candidate: Candidate, low: Number, high: Number) -> list[Number]:
    """Return the two values on both sides of the simplest threshold that are not known yet."""
    literal = concrete(candidate)
    value = literal.value
    assert isinstance(value, int | float)
    if number_bits(value) > 24:
        return []
    direction = 1 if literal.operator in (">", "<=") else -1
    sides = [step(value, direction), value]
    return [side for side in sides if low < side < high]


def _scale(value: Number) -> float:
    return math.copysign(math.log2(1 + abs(value)), value)


def _only(learnt: Learnt, place: tuple[int, int]) -> Rule:
    """Return where this literal alone decides: the rest of its term holds. Other terms are checked by the caller."""
    term = learnt.terms[place[0]]
    return Rule((tuple(concrete(other) for index, other in enumerate(term) if index != place[1]),))


def _solutions(
    table: Table, learnt: Learnt, place: tuple[int, int], targets: Sequence[Number], chance: random.Random
) -> list[Assignment]:
    """Return assignments whose feature is near a target and that no other term of the rule covers."""
    feature = learnt.terms[place[0]][place[1]].feature
    types = {variable.name: variable for variable in table.variables}
    bases = _bases(table, learnt, place, chance)
    options: list[Assignment] = []
    for target in targets:
        for base in bases:
            for change in _inversions(feature, base, target):
                fitted = {name: fit(value, types[name].type) for name, value in change.items()}
                if all(value is not None for value in fitted.values()):
                    options.append({**base, **{name: value for name, value in fitted.items() if value is not None}})
    others = Rule(tuple(tuple(map(concrete, term)) for index, term in enumerate(learnt.terms) if index != place[0]))
    if not options or not others.terms:
        return options
    taken = others.predict(columns_of(table.variables, options))
    return [option for option, other in zip(options, taken, strict=True) if not other]


def _bases(table: Table, learnt: Learnt, place: tuple[int, int], chance: random.Random) -> list[Assignment]:
    """Return the samples nearest to the threshold on both sides, and a few others that satisfy the rest of the term."""
    candidate = learnt.terms[place[0]][place[1]]
    values = table.values(candidate.feature)
    usable = _only(learnt, place).predict(columns_of(table.variables, table.assignments))
    rows = np.flatnonzero(usable).tolist()
    edge = [row for row in rows if values[row] in (candidate.inside, candidate.outside)]
    others = [row for row in rows if row not in edge]
    chance.shuffle(others)
    return [table.assignments[row] for row in edge[:4] + others[:8]]


def _inversions(feature: Feature, base: Assignment, target: Number) -> list[dict[str, Number]]:
    """Return changes of one or two variables that bring the feature to about the target."""
    first = feature.args[0]
    if len(feature.args) == 1:
        places = [target] if feature.kind == "raw" else [target, -target]
        return [{first: place} for place in places]
    second = feature.args[1]
    x, y = base[first], base[second]
    if not isinstance(x, int | float) or not isinstance(y, int | float) or not (math.isfinite(x) and math.isfinite(y)):
        x, y = 1, 1
    if feature.kind == "mul":
        changes: list[dict[str, Number]] = [{first: _ratio(target, y)}, {second: _ratio(target, x)}]
        for small in (1, -1, 2, -2, 3, 5, 7):
            changes += [{first: _ratio(target, small), second: small}, {first: small, second: _ratio(target, small)}]
        if isinstance(target, int):
            changes += _factors(first, second, target)
        return changes
    if feature.kind == "add" or feature.kind.startswith("wrap"):
        return [{first: target - y}, {second: target - x}]
    if feature.kind == "sub":
        return [{first: target + y}, {second: x - target}]
    if feature.kind == "div":
        ones: list[dict[str, Number]] = [{first: target * small, second: small} for small in (1, -1, 2, 10)]
        return [{first: target * y}, {second: _ratio(x, target)}, *ones]
    if feature.kind == "hypot":
        legs: list[dict[str, Number]] = []
        if abs(target) < 1e150 and abs(y) < abs(target):
            legs = [{first: math.sqrt(float(target) ** 2 - float(y) ** 2)}]
        return [*legs, {first: target, second: 0}, {first: 0, second: target}]
    return [{first: sign * target, second: side} for sign in (1, -1) for side in (y, 0, target)] + [
        {second: sign * target, first: side} for sign in (1, -1) for side in (x, 0, target)
    ]


def _factors(first: str, second: str, target: int) -> list[dict[str, Number]]:
    """Return pairs of integers with about this product, one of them small or near the root."""
    root = math.isqrt(abs(target))
    sizes = [size for size in (11, 13, 2**10, 2**16, root) if 0 < size <= abs(target)]
    exact = [size for size in range(2, 2000) if target and target % size == 0]
    return [{first: size * sign, second: target // size * sign} for size in sizes + exact[-8:] for sign in (1, -1)]


def _ratio(value: Number, by: Number) -> Number:
    if not by:
        return value
    return value // by if isinstance(value, int) and isinstance(by, int) else value / by
