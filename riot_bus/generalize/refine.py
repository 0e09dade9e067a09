"""Trials that put one feature between two known values and leave the rest of a rule as it is."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import WRAPS, compare
from riot_bus.generalize.numbers import between, logarithmic, number_bits, step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import Assignment, changed, columns_of, row_of
from riot_bus.generalize.table import Candidate, Table, concrete
from riot_bus.generalize.texts import resized
from riot_bus.vocabulary.message import Scalar

Number = int | float

_MOST_AROUND = 40
"""Numbers tried around a set: enough for all up to twice a largest member of 18; of wider sets the nearest ones."""
_FEW = 3
"""Largest number of samples on which a limit, a term or a literal may rest alone."""

LONGEST_TEXT = 1 << 16  # both sides of a limit of 16 bits can be tried; longer texts make trials slow


def decisive(rule: Rule, columns: Mapping[str, Array], failed: Array) -> list[int]:
    """Return samples that a rule gets right, and on which it depends so much that one wrong answer would change it."""
    predicted = rule.predict(columns)
    passing = ~failed & ~predicted
    held = [Rule((term,)).predict(columns) for term in rule.terms]
    alone = [term & failed & (np.sum(held, axis=0) == 1) for term in held]
    for literals in rule.terms:
        rests = (Rule((literals[:place] + literals[place + 1 :],)) for place in range(len(literals)))
        alone += [rest.predict(columns) & passing for rest in rests]
    chosen = [n for one in alone if one.sum() <= _FEW for n in np.flatnonzero(one).tolist()]
    rows = np.flatnonzero(passing)
    near = rows[np.argsort(rule.distance(columns, {})[rows], kind="stable")[:_FEW]]
    return list(dict.fromkeys([*chosen, *near.tolist()]))


def around(members: Sequence[int]) -> list[int]:
    """Return whole numbers that may belong to an enumeration of some: beside each, between, and up to twice them."""
    least, most = min(members), max(members)
    beside = {member + step for member in members for step in (-1, 1)}
    double = {2 * member for member in members} | {2 * member + 1 for member in members}
    between_ = range(least - 1, max(most, min(2 * most, most + _MOST_AROUND)) + 2)
    found = dict.fromkeys([*sorted(beside), *sorted(double), *between_[: 2 * _MOST_AROUND]])
    return [value for value in found if value not in members][:_MOST_AROUND]


def widen(table: Table, learnt: Learnt) -> Learnt:
    """Return the rule with the interval of each threshold set by the samples that its literal alone decides.

    The learner's interval may end at a sample that passes for another reason (the rest of the term does not hold), and
    samples may lie within an interval that was found where another literal holds. A limit that terms share stays one.
    """
    columns = table.columns
    failed = table.outcomes
    found = _between(learnt, columns, failed, _surely)
    return replace(found, terms=_without_idle([list(term) for term in found.terms], columns))


def narrowed(table: Table, learnt: Learnt) -> Learnt | None:
    """Return the rule with its thresholds adjusted to all trials; None if trials contradict it."""
    columns = table.columns
    failed = table.outcomes
    found = _between(learnt, columns, failed, _maybe)
    return found if (found.rule.predict(columns) == failed).all() else None


_Holds = Callable[[Candidate, Mapping[str, Array]], Array]


def _between(learnt: Learnt, columns: Mapping[str, Array], failed: Array, holds: _Holds) -> Learnt:
    """Return the rule with intervals from failing samples, where a literal `holds`, to those that pass due to it."""
    terms = [list(term) for term in learnt.terms]
    bits = learnt.bits
    nowhere = np.zeros(len(failed), dtype=bool)
    for candidate in {one: None for term in terms for one in term if one.operator in ("<", ">")}:
        within = [[one for one in term if one != candidate] for term in terms if candidate in term]
        rest = np.any([_all(term, columns, _surely) for term in within], axis=0)
        others = [_all(term, columns, holds) for term in terms if candidate not in term]
        alone = rest & ~np.any([nowhere, *others], axis=0)
        values = candidate.feature.values(columns)
        assert values is not None  # only numbers have thresholds
        inner = values[alone & failed & holds(candidate, columns)].tolist()
        outer = values[rest & ~failed & ~_surely(candidate, columns)].tolist()
        outer = [value for value in outer if value == value]  # without NaN
        if inner and outer:
            inside, outside = (min(inner), max(outer)) if candidate.operator == ">" else (max(inner), min(outer))
            if (inside > outside) is not (candidate.operator == ">") or inside == outside:
                continue  # a trial contradicts it
            wider = candidate.between(outside, inside)
            terms = [[wider if one == candidate else one for one in term] for term in terms]
            bits += wider.bits - candidate.bits
    return replace(learnt, terms=tuple(map(tuple, terms)), bits=bits)


def _all(term: Sequence[Candidate], columns: Mapping[str, Array], holds: _Holds) -> Array:
    every = np.ones(len(next(iter(columns.values()))), dtype=bool)
    return np.asarray(np.all([every, *(holds(one, columns) for one in term)], axis=0))


def _surely(candidate: Candidate, columns: Mapping[str, Array], *, outer: bool = False) -> Array:
    """Return where a literal holds with its threshold at the inner end of its interval, as learnt, or at the outer."""
    values = candidate.feature.values(columns)
    if candidate.operator not in ("<", ">") or values is None:
        return concrete(candidate).holds(columns)
    limit = (candidate.operator, candidate.outside) if outer else (f"{candidate.operator}=", candidate.inside)
    return compare(values, *limit)


_maybe = partial(_surely, outer=True)


def _without_idle(terms: list[list[Candidate]], columns: Mapping[str, Array]) -> tuple[tuple[Candidate, ...], ...]:
    """Return the terms without literals that decide no sample, longest first, and x for abs(x) if that suffices."""
    held: dict[Candidate, Array] = {one: concrete(one).holds(columns) for term in terms for one in term}
    for term in terms:
        for place, candidate in enumerate(term):
            if candidate.feature.kind == "abs":
                plain = replace(candidate, feature=Feature("raw", candidate.feature.args), bits=candidate.bits - 2.0)
                held[plain] = concrete(plain).holds(columns)
                changed = [*term[:place], plain, *term[place + 1 :]]
                whole = _both(term, held)
                if whole.any() and (_both(changed, held) == whole).all():
                    term[place] = plain
    kept = [list(term) for term in terms]
    shared = {one for term in kept for one in term if len(kept) > 1 and all(one in other for other in kept)}
    for candidate in sorted(held, key=lambda one: -one.bits):
        for group in [kept] if candidate in shared else [[term] for term in kept if candidate in term]:
            if all(_is_idle(candidate, term, held) for term in group):
                for term in group:
                    term.remove(candidate)
    return tuple(map(tuple, kept))


def _both(term: Sequence[Candidate], held: Mapping[Candidate, Array]) -> Array:
    return np.asarray(np.all([held[one] for one in term], axis=0))


def _is_idle(candidate: Candidate, term: Sequence[Candidate], held: Mapping[Candidate, Array]) -> bool:
    whole, rest = _both(term, held), [one for one in term if one != candidate]
    return bool(rest and whole.any() and (_both(rest, held) == whole).all())


def probe_threshold(
    table: Table,
    learnt: Learnt,
    place: tuple[int, int],
    chance: random.Random,
    *,
    turn: int,
    known: Callable[[Assignment], bool] = lambda _: False,
) -> Assignment | None:
    """Return a trial that narrows the threshold of the literal at a place (index of the term, and in it), if any."""
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
    solutions = _solutions(table, learnt, place, targets, chance)

    def within(some: Sequence[Assignment]) -> list[tuple[Number, Assignment]]:
        """Return those that this literal decides, with its value between the limits."""
        options = [one for one in some if not known(one)]
        if not options:
            return []
        columns = columns_of(table.variables, options)
        values = candidate.feature.values(columns)
        assert values is not None  # only numbers have thresholds
        free = zip(values.tolist(), options, without(learnt, place).predict(columns), strict=True)
        return [(value, option) for value, option, ok in free if ok and low < value < high]

    reached = within(solutions) or within(_repaired(table, learnt, place, solutions))
    for target in targets:
        exact = [option for value, option in reached if value == target]
        if exact:
            return exact[0]
    if not reached:
        return None
    goal = logarithmic(middle)
    return min(reached, key=lambda pair: abs(logarithmic(pair[0]) - goal))[1]


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


def without(learnt: Learnt, place: tuple[int, int]) -> Rule:
    """Return the rest of a literal's term: where it holds, the literal decides. Callers check other terms."""
    term = learnt.terms[place[0]]
    return Rule((tuple(concrete(other) for index, other in enumerate(term) if index != place[1]),))


def _solutions(
    table: Table, learnt: Learnt, place: tuple[int, int], targets: Sequence[Number], chance: random.Random
) -> list[Assignment]:
    """Return assignments whose feature is near a target and that no other term of the rule covers."""
    feature = learnt.terms[place[0]][place[1]].feature
    bases = _bases(table, learnt, place, chance)
    options: list[Assignment] = []
    for target in targets:
        for base in bases:
            for change in inversions(feature, row_of(table.variables, base), target):
                option = changed(table.variables, base, change)
                if option is not None:
                    options.append(option)
    others = Rule(tuple(tuple(map(concrete, term)) for index, term in enumerate(learnt.terms) if index != place[0]))
    if not options or not others.terms:
        return options
    taken = others.predict(columns_of(table.variables, options))
    return [option for option, other in zip(options, taken, strict=True) if not other]


def _repaired(table: Table, learnt: Learnt, place: tuple[int, int], options: Sequence[Assignment]) -> list[Assignment]:
    """Return options with other variables changed so that the rest of the term holds: y + h may wrap for each y."""
    own = learnt.terms[place[0]][place[1]].feature.args
    rest = [one for index, one in enumerate(learnt.terms[place[0]]) if index != place[1]]
    found: list[Assignment] = []
    for option in options:
        row = row_of(table.variables, option)
        for other in rest:
            if not isinstance(other.inside, int | float) or isinstance(other.inside, bool):
                continue
            for change in inversions(other.feature, row, other.inside):
                kept = all(change.get(name, row[name]) == row[name] for name in own)
                moved = changed(table.variables, option, change) if kept else None
                found += [] if moved is None else [moved]
    return found


def _bases(table: Table, learnt: Learnt, place: tuple[int, int], chance: random.Random) -> list[Assignment]:
    """Return the samples nearest to the threshold on both sides, and a few others that satisfy the rest of the term."""
    candidate = learnt.terms[place[0]][place[1]]
    values = table.values(candidate.feature)
    usable = without(learnt, place).predict(table.columns)
    rows = np.flatnonzero(usable).tolist()
    edge = [row for row in rows if values[row] in (candidate.inside, candidate.outside)]
    others = [row for row in rows if row not in edge]
    chance.shuffle(others)
    chosen = sorted(edge[:4] + others[:8], key=lambda row: table.failed[row])
    return [table.assignments[row] for row in chosen]


def inversions(feature: Feature, base: Mapping[str, Scalar], target: Number) -> list[dict[str, Scalar]]:
    """Return changes of one or more values of a row that bring a feature to about the target."""
    first = feature.args[0]
    if feature.kind in ("len", "bytes"):
        text = base[first]
        assert isinstance(text, str | bytes)
        return [{first: resized(text, int(target))}] if 0 <= target <= LONGEST_TEXT else []  # type: ignore[type-var]
    numbers = [base[name] for name in feature.args]
    known = [one if isinstance(one, int | float) and math.isfinite(one) else 1 for one in numbers]
    return [dict(zip(feature.args, change, strict=True)) for change in _changes(feature, known, target)]


def _changes(feature: Feature, known: list[Number], target: Number) -> Sequence[Sequence[Number]]:
    """Return values of the arguments that bring a feature to about the target."""
    kind, x, y = feature.kind, known[0], known[-1]
    if kind.startswith("cast"):
        size = 2 ** int(kind[4:])
        return [[target + turn * size] for turn in ((x - target) // size, 0, 1, -1)]
    if len(known) == 1:
        return [[target], [-target]] if kind == "abs" else [[target]]
    if kind == "mul":
        changes: list[Sequence[Number]] = [(_ratio(target, y), y), (x, _ratio(target, x))]
        for small in (1, -1, 2, -2, 3, 5, 7):
            changes += [(_ratio(target, small), small), (small, _ratio(target, small))]
        return changes + (_factors(target) if isinstance(target, int) else [])
    if isinstance(feature.constant, tuple) or kind in ("add", "sub"):
        weights = feature.constant if isinstance(feature.constant, tuple) else (1, -1 if kind == "sub" else 1)
        missing = target - sum(weight * value for weight, value in zip(weights, known, strict=True))
        moves = [value + _ratio(missing, weight) for value, weight in zip(known, weights, strict=True)]
        return [_at(known, place, value) for place, value in enumerate(moves)]
    wrap = WRAPS.match(kind)
    if wrap is not None:
        plain = Feature(wrap[2] or "add", feature.args)
        size = 2 ** int(kind[wrap.end() :])
        return [change for turn in (0, 1, -1, 2) for change in _changes(plain, known, target + turn * size)]
    if kind == "mul3":
        sides = ((0, 1, 2), (1, 0, 2), (2, 0, 1))
        changes = [_at(known, place, _ratio(target, known[one] * known[other])) for place, one, other in sides]
        return changes + [_at([1, 1, 1], place, target) for place in range(3)]
    if kind == "mulsub":
        _, middle, z = known
        values = (_ratio(target + z, middle), _ratio(target + z, x), x * middle - target)
        return [_at(known, place, value) for place, value in enumerate(values)]
    if kind == "div":
        return [(target * y, y), (x, _ratio(x, target)), *((target * small, small) for small in (1, -1, 2, 10))]
    if kind == "hypot":
        legs = [(math.sqrt(float(target) ** 2 - float(y) ** 2), y)] if abs(y) < abs(target) < 1e150 else []
        return [*legs, (target, 0), (0, target)]
    return [(sign * target, side) for sign in (1, -1) for side in (y, 0, target)] + [
        (side, sign * target) for sign in (1, -1) for side in (x, 0, target)
    ]


def _at(known: Sequence[Number], place: int, value: Number) -> list[Number]:
    return [*known[:place], value, *known[place + 1 :]]


def _factors(target: int) -> list[Sequence[Number]]:
    """Return pairs of integers with about this product, one of them small or near the root."""
    root = math.isqrt(abs(target))
    sizes = [size for size in (11, 13, 2**10, 2**16, root) if 0 < size <= abs(target)]
    exact = [size for size in range(2, 2000) if target and target % size == 0]
    return [(size * sign, target // size * sign) for size in sizes + exact[-8:] for sign in (1, -1)]


def _ratio(value: Number, by: Number) -> Number:
    if not by:
        return value
    return value // by if isinstance(value, int) and isinstance(by, int) else value / by
