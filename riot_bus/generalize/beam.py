"""The learner: a small disjunctive rule of least description length, by beam search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import LARGEST_SET, Literal
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.table import Candidate, concrete

ERROR_BITS = 12.0
"""Cost of one sample that the rule gets wrong."""

MOST_TERMS = 4
"""Most terms of a rule, most literals of a term, and of a guard."""


@dataclass(frozen=True, slots=True)
class Learnt:
    """A rule with the intervals its thresholds came from, its description length and its mistakes on the samples."""

    terms: tuple[tuple[Candidate, ...], ...]
    bits: float
    mistakes: int

    @property
    def rule(self) -> Rule:
        """The rule with the simplest thresholds."""
        return Rule(tuple(_with_sets([concrete(candidate) for candidate in term]) for term in self.terms))

    @property
    def shape(self) -> tuple[object, ...]:
        """The rule without its thresholds."""
        return tuple(sorted(tuple(sorted((c.feature, c.operator) for c in term)) for term in self.terms))


def _with_sets(term: Sequence[Literal]) -> tuple[Literal, ...]:
    """Return a term that says `x not in (1, 8)` instead of `x != 1 and x != 8`; it holds for the same values."""
    unequal: dict[tuple[Feature, type], list[Literal]] = {}
    for literal in term:
        if literal.operator == "!=" and literal.feature.kind == "raw" and isinstance(literal.value, int | str | bytes):
            unequal.setdefault((literal.feature, type(literal.value)), []).append(literal)
    found = list(term)
    for (feature, _), literals in unequal.items():
        if 2 <= len(literals) <= LARGEST_SET and not isinstance(literals[0].value, bool):
            members: Any = tuple(sorted(literal.value for literal in literals))
            found[found.index(literals[0])] = Literal(feature, "not in", members)
            found = [literal for literal in found if literal not in literals]
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Term:
    literals: tuple[int, ...]
    mask: Array
    bits: float


def learn(candidates: Sequence[Candidate], masks: Array, failed: Array, *, width: int = 3, beam: int = 24) -> Learnt:
    """Return the disjunction of at most 4 terms of at most 4 literals with the least description length.

    `masks` (candidates x samples) tells where literals hold; `width` rules and `beam` terms are kept per step.
    """
    bits = np.array([candidate.bits for candidate in candidates]) + np.log2(2.0 + len(candidates)) / 4
    keep = _distinct(masks, bits)
    if failed.all() or not len(keep):
        return Learnt(((),) if failed.all() else (), 0.0, 0 if failed.all() else int(failed.sum()))
    masks, bits = masks[keep], bits[keep]
    matrix = masks.astype(np.float32)
    names = [(candidates[index].feature, candidates[index].operator) for index in keep.tolist()]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    kinds = np.array([numbers[name] for name in names], dtype=np.int64)
    states: list[tuple[float, tuple[_Term, ...]]] = [(float(_weights(failed)[failed].sum()), ())]
    best = states[0]
    pool: dict[bytes, _Term] = {}
    for _ in range(MOST_TERMS):
        grown: list[tuple[float, tuple[_Term, ...]]] = []
        for _, terms in states:
            covered = _union(terms, failed)
            if not (failed & ~covered).any():
                continue
            found = _terms(matrix, masks, bits, kinds, failed, covered, beam)
            for size in range(1, MOST_TERMS + 1):
                # `_improve` compares all pairs of pooled terms: twice as many take four times as long
                for term in [term for term in found if len(term.literals) == size][: 12 if size > 1 else None]:
                    key = term.mask.tobytes()
                    if key not in pool or term.bits < pool[key].bits:
                        pool[key] = term
            for term in _different(found, width):
                wrong = (covered | term.mask) != failed
                cost = float(_weights(failed)[wrong].sum()) + sum(t.bits for t in terms) + term.bits
                grown.append((cost, (*terms, term)))
        grown.sort(key=lambda state: (state[0], [term.literals for term in state[1]]))
        if not grown or grown[0][0] >= best[0] + 2 * ERROR_BITS:
            break
        states = grown[:width]
        best = min(best, states[0], key=lambda state: state[0])
    cost, chosen_terms = _improve(best, list(pool.values()), failed)
    covered = _union(chosen_terms, failed)
    ordered = sorted(chosen_terms, key=lambda term: (term.bits, term.literals))
    chosen = tuple(_readable([candidates[keep[index]] for index in term.literals]) for term in ordered)
    return Learnt(chosen, cost, int((covered != failed).sum()))


def learn_guarded(candidates: Sequence[Candidate], masks: Array, failed: Array, plain: Learnt) -> Learnt:
    """Return a rule whose terms all share literals that hold for every failure, such as "all finite", or `plain`.

    Learning term by term does not find such literals: each one costs more than it gains in its term. The guard and the
    rule within it are chosen in turns.
    """
    needed = np.flatnonzero(masks[:, failed].all(axis=1) & ~masks.all(axis=1))
    if not len(needed) or not failed.any():
        return plain
    some = [candidates[index] for index in needed.tolist()]
    bits = np.array([one.bits for one in some]) + np.log2(2.0 + len(candidates)) / 4
    finite = np.array([(one.feature.kind, one.operator) == ("nonfinite", "not") for one in some])
    places = {candidate: index for index, candidate in enumerate(candidates)}
    best, wrong = plain, ~failed
    before: list[int] = []
    for _ in range(2):  # the second leaves out what the rule within the first says; a third seldom changes it
        guard, cost = _guard(masks[needed], bits, finite, wrong)
        if guard == before:
            break
        before, chosen = guard, needed[guard]
        within = masks[chosen].all(axis=0)
        inner = learn(candidates, masks[:, within], failed[within], width=1, beam=16)
        covers = np.zeros(len(failed), dtype=bool)
        for term in inner.terms:
            covers |= masks[[places[one] for one in term]].all(axis=0)
        wrong = covers & ~failed
        if inner.bits + cost < best.bits:
            shared = [candidates[index] for index in chosen.tolist()]
            terms = tuple(_readable([*shared, *(one for one in term if one not in shared)]) for term in inner.terms)
            best = Learnt(terms, inner.bits + cost, inner.mistakes)
    return best


def _guard(masks: Array, bits: Array, finite: Array, wrong: Array) -> tuple[list[int], float]:
    """Return "all finite" and the literals that exclude the most samples not to be covered, and their cost.

    Each further variable that has to be finite costs less: people say "all finite" of variables that belong together.
    """
    chosen = np.flatnonzero(finite).tolist()
    costs = np.where(finite & (np.cumsum(finite) > 1), np.minimum(bits, 1.5), bits)
    left = wrong & masks[chosen].all(axis=0)
    for _ in range(MOST_TERMS):
        gain = ERROR_BITS * (~masks[:, left]).sum(axis=1) - costs
        index = int(np.argmax(gain))
        if gain[index] <= 0:
            break
        chosen.append(index)
        left &= masks[index]
    return chosen, float(costs[chosen].sum())


def _readable(literals: list[Candidate]) -> tuple[Candidate, ...]:
    """Return the literals of a term as people write them: modes first, then the simplest."""
    return tuple(sorted(literals, key=lambda literal: (literal.operator != "==", literal.feature, literal.operator)))


def _weights(failed: Array) -> Array:
    """Return the cost of getting each sample wrong; rare failures cost more, so that their rule is not "never"."""
    missed = ERROR_BITS * max(1.0, 4 / max(float(failed.sum()), 1.0))
    return np.asarray(np.where(failed, missed, ERROR_BITS))


def _different(terms: Sequence[_Term], count: int) -> list[_Term]:
    """Return the first terms that hold on different samples."""
    chosen: dict[bytes, _Term] = {}
    for term in terms:
        chosen.setdefault(term.mask.tobytes(), term)
        if len(chosen) == count:
            break
    return list(chosen.values())


def _improve(
    best: tuple[float, tuple[_Term, ...]], pool: list[_Term], failed: Array
) -> tuple[float, tuple[_Term, ...]]:
    """Drop, add and exchange single terms of the best rule so far, or of the best pair, while it gets shorter."""
    if not pool:
        return best
    masks = np.array([term.mask for term in pool])
    costs = np.array([term.bits for term in pool])
    # Wrong samples of a | b from counts of a, b and a & b.
    weights = _weights(failed)
    sign = np.where(failed, -weights, weights)
    none = float(weights[failed].sum())
    alone = masks @ sign
    both = (masks * sign) @ masks.T.astype(np.float64)
    pairs = none + alone[:, None] + alone[None, :] - both + costs[:, None] + costs[None, :]
    np.fill_diagonal(pairs, none + alone + costs)
    left, right = divmod(int(np.argmin(pairs)), len(pool))
    pair = (float(pairs[left, right]), tuple(pool[index] for index in sorted({left, right})))
    best = min(best, pair, key=lambda state: state[0])
    while True:
        cost, terms = best
        smaller = [terms[:index] + terms[index + 1 :] for index in range(len(terms))]
        for rest in [*smaller, terms]:
            covered = _union(rest, failed)
            spent = sum(term.bits for term in rest)
            bare = float(weights[covered != failed].sum()) + spent
            best = min(best, (bare, rest), key=lambda state: state[0])
            if len(rest) < MOST_TERMS:
                grown = ((covered[None, :] | masks) != failed) @ weights + spent + costs
                index = int(np.argmin(grown))
                best = min(best, (float(grown[index]), (*rest, pool[index])), key=lambda state: state[0])
        if best[0] >= cost - 1e-6:
            return best


def _union(terms: tuple[_Term, ...], failed: Array) -> Array:
    covered = np.zeros(len(failed), dtype=bool)
    for term in terms:
        covered |= term.mask
    return covered


def _distinct(masks: Array, bits: Array) -> Array:
    """Return the cheapest candidate of each distinct mask, without those that hold nowhere or everywhere."""
    packed = np.packbits(masks, axis=1)
    count = masks.sum(axis=1)
    some: Array = (count > 0) & (count < masks.shape[1])
    chosen: dict[bytes, int] = {}
    for index in np.argsort(bits, kind="stable").tolist():
        if some[index]:
            chosen.setdefault(packed[index].tobytes(), index)
    return np.array(sorted(chosen.values()), dtype=np.int64)


def _terms(
    matrix: Array, masks: Array, bits: Array, kinds: Array, failed: Array, covered: Array, beam: int
) -> list[_Term]:
    """Return terms by falling value: bits saved on failing samples not covered yet, minus passing ones included."""
    weight = np.float32(_weights(failed).max())
    want, avoid = failed & ~covered, ~failed
    useful = np.flatnonzero(matrix[:, want].any(axis=1))  # the others hit nothing, whatever they are joined to
    wanted, avoided = matrix[np.ix_(useful, want)].T, matrix[np.ix_(useful, avoid)].T
    masks, bits, kinds = masks[useful], bits[useful].astype(np.float32), kinds[useful]
    base = np.log2(want.sum() / (want.sum() + avoid.sum())).astype(np.float32)
    frontier = [_Term((), np.ones(len(failed), dtype=bool), 1.0)]
    found: dict[tuple[int, ...], tuple[float, _Term]] = {}
    for _ in range(MOST_TERMS):
        rows = np.array([term.mask for term in frontier], dtype=np.float32)
        with np.errstate(invalid="ignore"):  # products of 0 and 1, but BLAS may set the flag for lanes it does not use
            hits, misses = rows[:, want] @ wanted, rows[:, avoid] @ avoided
        costs = np.array([term.bits for term in frontier], dtype=np.float32)[:, None] + bits[None, :]
        value = weight * hits - np.float32(ERROR_BITS) * misses - costs
        promise = hits * (np.log2((hits + np.float32(0.1)) / (hits + misses + np.float32(0.2))) - base)
        promise -= np.float32(0.1) * costs
        none = hits < 1
        promise[none] = value[none] = -np.inf
        picks = {*_top(value, 8), *_top(promise, beam)}
        if not frontier[0].literals:
            # The best threshold of each feature: else the thresholds of one feature crowd out all others.
            order = np.argsort(-value[0], kind="stable")
            picks |= {(0, int(order[first])) for first in np.unique(kinds[order], return_index=True)[1]}
        following: dict[tuple[int, ...], _Term] = {}
        for parent, column in sorted(picks):
            literal = int(useful[column])
            if not np.isfinite(value[parent, column]) or literal in frontier[parent].literals:
                continue
            term = _Term(
                tuple(sorted((*frontier[parent].literals, literal))),
                frontier[parent].mask & masks[column],
                float(costs[parent, column]),
            )
            found[term.literals] = (float(value[parent, column]), term)
            if misses[parent, column] > 0:
                following[term.literals] = term
        frontier = list(following.values())
        if not frontier:
            break
    ranked = sorted(found.values(), key=lambda item: (-item[0], item[1].literals))
    return [term for _, term in ranked]


def _top(score: Array, count: int) -> list[tuple[int, int]]:
    flat = score.ravel()
    count = min(count, flat.size)
    best = np.argpartition(-flat, count - 1)[:count]
    return [(int(index) // score.shape[1], int(index) % score.shape[1]) for index in best]
