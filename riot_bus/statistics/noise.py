"""Decisions from trials that may be wrong: where the outcome flips along a chain of inputs, whether one triggers it.

A trial fails with probability p where its input triggers the failure, and with probability eps where it does not. Both
are learnt on the way: all here is one posterior over the hypotheses at hand times a grid of p and eps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FlipSearch", "Noise"]

Array = NDArray[np.float64]

_RELIABLE = 0.7
"""Prior that a failure which was found is reliable (p = 1): most are. Less costs reliable units trials, more makes
rates of 0.9 be taken for 1: benchmarks/noise.py holds both against each other."""
_RATES = (1.0, 0.97, 0.93, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
_AS_GOOD = 0.995
"""Of questions that tell as much, the first is asked: the shortest prefix."""
_FALSE = ((0.001, 0.6), (0.004, 0.2), (0.01, 0.13), (0.03, 0.05), (0.1, 0.02))
"""Chances of a failure without its cause, and their priors; never 0, so that no single trial decides for good."""


@dataclass(frozen=True)
class Noise:
    """What is known of p and eps: a weight for each pair of a grid.

    Attributes:
        p: Shape (pairs,).
        eps: Shape (pairs,), as of p.
        weight: Likewise; the sum is 1.
    """

    p: Array
    eps: Array
    weight: Array

    @classmethod
    def after(cls, failed: int = 0, total: int = 0, *, nominal_failed: int = 0, nominal_total: int = 0) -> Noise:
        """Return what is known after so many fresh trials.

        Args:
            failed: Trials of what triggers the failure that failed.
            total: Number of trials of that.
            nominal_failed: Trials of what does not trigger it that failed all the same.
            nominal_total: Number of nominal trials.
        """
        chances = [_RELIABLE] + [(1 - _RELIABLE) / (len(_RATES) - 1)] * (len(_RATES) - 1)
        rates = zip(_RATES, chances, strict=True)
        pairs = [(rate, false, chance * prior) for rate, chance in rates for false, prior in _FALSE]
        p, eps, weight = (np.array(column) for column in zip(*pairs, strict=True))
        blank = cls(p, eps, weight)
        does, _ = blank.likelihood(failed, total - failed)
        _, does_not = blank.likelihood(nominal_failed, nominal_total - nominal_failed)
        return blank.weighted(does * does_not)

    @property
    def rate(self) -> float:
        """Expected p."""
        return float(self.weight @ self.p)

    @property
    def false_rate(self) -> float:
        """Expected eps."""
        return float(self.weight @ self.eps)

    @property
    def spread(self) -> float:
        """Standard deviation of p."""
        return math.sqrt(max(0.0, float(self.weight @ self.p**2) - self.rate**2))

    def missed(self, trials: int) -> float:
        """Return the probability that none of so many trials of what triggers the failure fails."""
        return float(self.weight @ (1 - self.p) ** trials)

    def weighted(self, factor: Array) -> Noise:
        """Return what is known after something that is so likely for each pair; shape (pairs,)."""
        weight = self.weight * factor
        return Noise(self.p, self.eps, weight / weight.sum())

    def joined(self, others: Sequence[Noise]) -> Noise:
        """Return what is known after several searches that began with this and shared no trial."""
        possible = self.weight > 0
        factor = np.ones_like(self.weight)
        for other in others:
            factor[possible] *= other.weight[possible] / self.weight[possible]
        return self.weighted(factor)

    def likelihood(self, failed: int, passed: int) -> tuple[Array, Array]:
        """Return how likely so many failures and passes are where the input triggers, and where not; shape (pairs,)."""
        return self.p**failed * (1 - self.p) ** passed, self.eps**failed * (1 - self.eps) ** passed

    def triggers(self, failed: int, passed: int, *, prior: float = 0.5) -> float:
        """Return the probability that an input triggers the failure after so many trials that are not in it yet."""
        does, does_not = (float(self.weight @ one) for one in self.likelihood(failed, passed))
        return prior * does / (prior * does + (1 - prior) * does_not)


class FlipSearch:
    """Where the outcome flips along a chain of inputs 0..n, each nearer to the other side than the one before.

    Hypothesis k: inputs at positions below k are as the start is, all others are not. k = n + 1: none flips. With
    n = 0, two hypotheses are left, and the search decides whether one input triggers the failure.

    Args:
        masses: Prior weights of the hypotheses; shape (n + 2,).
        noise: What is known of p and eps.
        rises: Whether inputs trigger the failure from the flip on, rather than before it.
    """

    def __init__(self, masses: Sequence[float], noise: Noise, *, rises: bool) -> None:
        given = np.maximum(np.asarray(masses, dtype=np.float64), 0.0)
        self._noise = noise
        self._rises = rises
        self._joint = np.outer(noise.weight, given / given.sum())
        self.trials = 0

    @property
    def found(self) -> int:
        """The likeliest hypothesis."""
        return int(self._joint.sum(axis=0).argmax())

    @property
    def confidence(self) -> float:
        """Its probability."""
        return float(self._joint.sum(axis=0).max())

    @property
    def noise(self) -> Noise:
        """What is known of p and eps by now, whatever the hypothesis."""
        return Noise(self._noise.p, self._noise.eps, self._joint.sum(axis=1))

    def tell(self, position: int, *, failed: bool) -> None:
        """Take in one trial of the input at a position."""
        does, does_not = self._noise.likelihood(int(failed), int(not failed))
        before, after = (does_not, does) if self._rises else (does, does_not)
        self._joint[:, : position + 1] *= after[:, None]  # hypotheses that have flipped by this position
        self._joint[:, position + 1 :] *= before[:, None]
        self._joint /= self._joint.sum()
        self.trials += 1

    def questions(self, count: int = 1) -> list[int]:
        """Return up to so many positions to ask next: the most informative one, and others that divide what is left."""
        mass = self._joint.sum(axis=0)
        reached = np.cumsum(mass)[:-1]  # at position x: the hypotheses 0..x have flipped
        told = self._information(mass)
        best = int(np.flatnonzero(told >= _AS_GOOD * told.max())[0])
        parts = [int(np.searchsorted(reached, part / (count + 1))) for part in range(1, count + 1)]
        parts = [place for place in parts if place < len(reached)]
        if parts:
            parts.remove(min(parts, key=lambda place: abs(place - best)))
        return [best, *sorted({place for place in parts if place != best and 0.01 < reached[place] < 0.99})]

    def _information(self, mass: Array) -> Array:
        """Return for each position how much a trial tells of the hypotheses, in bits; shape (n + 1,)."""
        # No `@`: threads of BLAS wait for each other where trials have the processors.
        does, does_not = (np.einsum("g,gk->k", rate, self._joint) for rate in (self._noise.p, self._noise.eps))
        before, after = (does_not, does) if self._rises else (does, does_not)
        fails = np.cumsum(after)[:-1] + np.cumsum(before[::-1])[::-1][1:]
        spread_after, spread_before = mass * _entropy(after, mass), mass * _entropy(before, mass)
        left = np.cumsum(spread_after)[:-1] + np.cumsum(spread_before[::-1])[::-1][1:]
        told: Array = _entropy(fails, np.ones_like(fails)) - left
        return told


def _entropy(part: Array, whole: Array) -> Array:
    """Return the entropy of part/whole in bits; 0 where there is nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(part / whole, 0.0, 1.0)
        bits: Array = -(share * np.log2(share) + (1 - share) * np.log2(1 - share))
    return np.nan_to_num(bits)
