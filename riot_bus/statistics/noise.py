"""Decisions from noisy trials: where the outcome flips along a chain of inputs, or whether an input triggers a failure.

A trial fails with probability p if its input triggers the failure, and with probability eps if not. Both are learnt on
the way: the state is one joint posterior over the hypotheses and a grid of p and eps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RELIABLE = 0.7
"""Prior probability that a failure is reliable (p = 1), as most are. A lower value costs reliable units trials; with a
higher one, rates of 0.9 are taken for 1. benchmarks/noise.py weighs the two."""
_RATES = (1.0, 0.97, 0.93, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
_AS_GOOD = 0.995
"""Share of the most information from which on a question is as good; the first such one, the shortest prefix, wins."""
_FALSE = ((0.001, 0.6), (0.004, 0.2), (0.01, 0.13), (0.03, 0.05), (0.1, 0.02))
"""Values of eps and their priors; eps is never 0, so that no single trial decides for good."""


@dataclass(frozen=True)
class Noise:
    """Posterior of p and eps: a weight for each pair of a grid.

    Attributes:
        p: Value of p for each pair; shape (pairs,).
        eps: Value of eps for each pair; shape (pairs,).
        weight: Probability of each pair; shape (pairs,), with sum 1.
    """

    p: Array
    eps: Array
    weight: Array

    @classmethod
    def after(cls, failed: int = 0, total: int = 0, *, nominal_failed: int = 0, nominal_total: int = 0) -> Noise:
        """Return the posterior after some trials, starting from the prior.

        The nominal trials are those of inputs that do not trigger the failure.
        """
        chances = [_RELIABLE] + [(1 - _RELIABLE) / (len(_RATES) - 1)] * (len(_RATES) - 1)
        rates = zip(_RATES, chances, strict=True)
        pairs = [(rate, false, chance * prior) for rate, chance in rates for false, prior in _FALSE]
        p, eps, weight = (np.array(column) for column in zip(*pairs, strict=True))
        blank = cls(p, eps, weight)
        logarithm = _log_likelihood(p, failed, total - failed)
        logarithm += _log_likelihood(eps, nominal_failed, nominal_total - nominal_failed)
        return blank.weighted(np.exp(logarithm - logarithm.max()))

    @property
    def rate(self) -> float:
        """Expected p."""
        return float(self.weight @ self.p)

    @property
    def spread(self) -> float:
        """Standard deviation of p."""
        return math.sqrt(max(0.0, float(self.weight @ self.p**2) - self.rate**2))

    def missed(self, trials: int) -> float:
        """Return the probability that none of these trials fails, if their input triggers the failure."""
        return float(self.weight @ (1 - self.p) ** trials)

    def weighted(self, factor: Array) -> Noise:
        """Return the posterior after an observation with this likelihood for each pair; shape (pairs,)."""
        weight = self.weight * factor
        return Noise(self.p, self.eps, weight / weight.sum())

    def joined(self, others: Sequence[Noise]) -> Noise:
        """Return the posterior after several searches that all started from this one and shared no trial."""
        possible = self.weight > 0
        factor = np.ones_like(self.weight)
        for other in others:
            factor[possible] *= other.weight[possible] / self.weight[possible]
        return self.weighted(factor)

    def likelihood(self, failed: int, passed: int) -> tuple[Array, Array]:
        """Return the likelihoods of these counts if the input triggers the failure, and if not; shape (pairs,).

        Both are divided by the largest of them all, since those of a thousand trials are smaller than any float.
        """
        does, does_not = (_log_likelihood(one, failed, passed) for one in (self.p, self.eps))
        largest = max(does.max(), does_not.max())
        return np.exp(does - largest), np.exp(does_not - largest)

    def triggers(self, failed: int, passed: int, *, prior: float = 0.5) -> float:
        """Return the probability that an input triggers the failure, given further trials of it."""
        does, does_not = (float(self.weight @ one) for one in self.likelihood(failed, passed))
        return prior * does / (prior * does + (1 - prior) * does_not)


class FlipSearch:
    """Search for the flip of the outcome along a chain of inputs 0..n, which lead from one outcome to the other.

    Hypothesis k: inputs at positions below k have the outcome of the start, all others the opposite one. k = n + 1:
    there is no flip. With n = 0, two hypotheses are left: the search decides whether one input triggers the failure.

    Args:
        masses: Prior weights of the hypotheses; shape (n + 2,).
        noise: Prior of p and eps.
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
        """The probability of the likeliest hypothesis."""
        return float(self._joint.sum(axis=0).max())

    @property
    def noise(self) -> Noise:
        """The marginal posterior of p and eps so far."""
        return Noise(self._noise.p, self._noise.eps, self._joint.sum(axis=1))

    def tell(self, position: int, *, failed: bool) -> None:
        """Update the posterior with one trial of the input at a position."""
        does, does_not = self._noise.likelihood(int(failed), int(not failed))
        before, after = (does_not, does) if self._rises else (does, does_not)
        self._joint[:, : position + 1] *= after[:, None]  # hypotheses that have flipped by this position
        self._joint[:, position + 1 :] *= before[:, None]
        self._joint /= self._joint.sum()
        self.trials += 1

    def questions(self, count: int = 1) -> list[int]:
        """Return up to `count` positions to try next: the most informative one, and others that divide the rest."""
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
        """Return the expected information of a trial at each position, in bits; shape (n + 1,)."""
        # No `@`: threads of BLAS wait for each other when trials occupy the processors.
        does, does_not = (np.einsum("g,gk->k", rate, self._joint) for rate in (self._noise.p, self._noise.eps))
        before, after = (does_not, does) if self._rises else (does, does_not)
        fails = np.cumsum(after)[:-1] + np.cumsum(before[::-1])[::-1][1:]
        spread_after, spread_before = mass * _entropy(after, mass), mass * _entropy(before, mass)
        left = np.cumsum(spread_after)[:-1] + np.cumsum(spread_before[::-1])[::-1][1:]
        told: Array = _entropy(fails, np.ones_like(fails)) - left
        return told


def _log_likelihood(rate: Array, failed: int, passed: int) -> Array:
    """Return log(rate ** failed * (1 - rate) ** passed), where 0 to the power of 0 is 1."""
    logarithm = np.zeros_like(rate)
    with np.errstate(divide="ignore"):
        for base, exponent in ((rate, failed), (1 - rate, passed)):
            if exponent:
                logarithm += exponent * np.log(base)
    return logarithm


def _entropy(part: Array, whole: Array) -> Array:
    """Return the binary entropy of part/whole in bits; 0 where it is undefined."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(part / whole, 0.0, 1.0)
        bits: Array = -(share * np.log2(share) + (1 - share) * np.log2(1 - share))
    return np.nan_to_num(bits)
