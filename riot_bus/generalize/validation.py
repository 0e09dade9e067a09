"""Fresh trials that may show that a rule is wrong, and its scores from them, with confidence intervals that cover.

The stated distribution of validation: half of the cases lie near a limit of the rule (one step to half of the limit's
size beside it on either side, the same with the sign changed, between the last passing and the first failing trial),
at least half of them where the rest of its term holds, so that this limit decides; half are drawn from the nominal
range, the dictionary, and over the whole type. Trials are taken half where the rule predicts a failure and half where
not; rates are weighted back by how often either occurs in the distribution.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.numbers import between, step
from riot_bus.generalize.refine import inversions, without
from riot_bus.generalize.sampling import Assignment, Sampler, changed, row_of
from riot_bus.generalize.table import Candidate, Table, concrete
from riot_bus.statistics.rates import exact_interval
from riot_bus.vocabulary.elements import Setting

Number = int | float


@dataclass(frozen=True, slots=True)
class Estimate:
    """A rate of the stated distribution with its 95 % interval; `rate` is None if no trial tells it.

    `hits` of `total` are the trials behind it; a rate that is weighted is not their quotient.
    """

    rate: float | None
    low: float
    high: float
    hits: int
    total: int


@dataclass(frozen=True, slots=True)
class Scores:
    """What fresh trials say about a rule; the balanced accuracy is None unless some failed and some passed."""

    precision: Estimate
    recall: Estimate
    balanced_accuracy: float | None


def scores(predicted: Sequence[bool], failed: Sequence[bool], share: float) -> Scores:
    """Return the scores of a rule from trials that were taken separately inside and outside of it.

    Args:
        predicted: (trials,): whether the rule predicts a failure.
        failed: (trials,): whether there was one.
        share: Part of the stated distribution for which the rule predicts a failure.
    """
    inside, outcome = np.array(predicted, dtype=bool), np.array(failed, dtype=bool)
    caught, missed = int((inside & outcome).sum()), int((~inside & outcome).sum())
    claimed, rest = int(inside.sum()), int((~inside).sum())
    low, high = exact_interval(caught, claimed)
    precision = Estimate(caught / claimed if claimed else None, low, high, caught, claimed)
    # Failures per case of the distribution, inside and outside. Both intervals at 97.5 %: together they cover at 95 %.
    (low_in, high_in), (low_out, high_out) = (
        exact_interval(*counts, confidence=0.975) for counts in ((caught, claimed), (missed, rest))
    )
    low_in, high_in, low_out, high_out = share * low_in, share * high_in, (1 - share) * low_out, (1 - share) * high_out
    failing_in = share * caught / claimed if claimed else 0.0
    failing_out = (1 - share) * missed / rest if rest else 0.0
    total = failing_in + failing_out
    recall = Estimate(
        failing_in / total if total else None,
        low_in / (low_in + high_out) if low_in + high_out else 0.0,
        high_in / (high_in + low_out) if high_in + low_out else 1.0,
        caught,
        caught + missed,
    )
    passing = (1 - share - failing_out) + (share - failing_in)
    if recall.rate is None or passing <= 0 or caught + missed == len(outcome):
        return Scores(precision, recall, None)
    specificity = (1 - share - failing_out) / passing
    return Scores(precision, recall, (recall.rate + specificity) / 2)


def near_limits(table: Table, learnt: Learnt, sampler: Sampler, chance: random.Random, count: int) -> list[Assignment]:
    """Return at most `count` cases near the limits of a rule: known ones, or new draws, moved to a limit."""
    limits: dict[Candidate, list[tuple[int, int]]] = {}  # one that several terms share is one limit
    for row, term in enumerate(learnt.terms):
        for column, candidate in enumerate(term):
            limits.setdefault(candidate, []).append((row, column))
    places = [place for each in limits.values() for place in each]
    columns = table.columns
    decided = {place: np.flatnonzero(without(learnt, place).predict(columns)).tolist() for place in places}
    found: list[Assignment] = []
    for _ in range(count if places else 0):
        place, way = chance.choice(chance.choice(list(limits.values()))), chance.random()
        if way < 0.5 and decided[place]:
            base: Assignment = table.assignments[chance.choice(decided[place])]
        else:
            base = chance.choice(table.assignments) if way < 0.8 else sampler.assignment(chance)
        candidate = learnt.terms[place[0]][place[1]]
        moved = changed(table.variables, base, _move(candidate, base, sampler, chance))
        if moved is not None:
            found.append(moved)
    return found


def _move(candidate: Candidate, base: Assignment, sampler: Sampler, chance: random.Random) -> dict[str, Setting]:
    """Return a change of the base that brings a literal near its limit, or gives its variable another value."""
    feature = candidate.feature
    limit = concrete(candidate).value
    if (
        not isinstance(limit, int | float)
        or isinstance(limit, bool)
        or (feature.constant is not None and not isinstance(feature.constant, tuple))
    ):
        variable = sampler.behind(chance.choice(feature.args))
        return {variable.name: sampler.value(variable, chance)}
    target = _beside(limit, candidate, chance)
    return dict(chance.choice(inversions(feature, row_of(sampler.variables, base), target) or [{}]))


def _beside(limit: Number, candidate: Candidate, chance: random.Random) -> Number:
    """Return the limit, the number next to it, one near it or its negative, or the middle of its interval.

    Near means within about half of the limit's size, or of 1 if that is larger.
    """
    kind = chance.randrange(5)
    if kind == 0:
        return limit
    if kind == 1:
        return step(limit, chance.choice((-1, 1)))
    low, high = candidate.outside, candidate.inside
    if kind == 2 and isinstance(low, int | float) and isinstance(high, int | float):
        middle = between(*sorted((low, high)))
        return limit if middle is None else middle
    size = max(abs(limit), 1) * 10 ** chance.uniform(-6, -0.3)
    moved = (-limit if kind == 3 else limit) + chance.choice((-1, 1)) * size
    return round(moved) if isinstance(limit, int) else moved
