"""Rates: observed proportions, and the exact intervals of the underlying rates."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Proportion:
    """`hits` of `total`, and the Clopper-Pearson interval of the underlying rate."""

    hits: int
    total: int
    low: float
    high: float

    @property
    def rate(self) -> float:
        """The observed rate; 1 when there was nothing to observe."""
        return self.hits / self.total if self.total else 1.0


def proportion(hits: int, total: int, *, confidence: float = 0.95) -> Proportion:
    """Return a proportion with its exact (Clopper-Pearson) interval."""
    return Proportion(hits, total, *exact_interval(hits, total, confidence=confidence))


def exact_interval(hits: int, total: int, *, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact (Clopper-Pearson) interval of a rate that was observed as `hits` of `total`."""
    if total < 1:
        return 0.0, 1.0
    hits, tail = min(max(hits, 0), total), (1 - confidence) / 2
    low = _crossing(hits, total, tail) if hits else 0.0
    high = 1.0 - _crossing(total - hits, total, tail) if hits < total else 1.0
    return low, high


def chance_of_difference(hits: int, total: int, other_hits: int, other_total: int) -> float:
    """Return the one-sided p-value of Fisher's exact test that the first rate is higher than the other one.

    Example:
        >>> round(chance_of_difference(4, 4, 0, 10), 4)
        0.001
    """
    both = hits + other_hits
    ways = sum(math.comb(total, count) * math.comb(other_total, both - count) for count in range(hits, both + 1))
    return ways / math.comb(total + other_total, both)


@functools.lru_cache(4096)
def _crossing(hits: int, total: int, tail: float) -> float:
    """Return the rate at which `hits` or more of `total` have the probability `tail`."""
    log = [math.lgamma(count + 1) for count in range(total + 1)]  # of factorials
    ways = [(log[-1] - log[count] - log[total - count], count, total - count) for count in range(hits, total + 1)]
    low, high = 0.0, 1.0
    for _ in range(60):  # to 2**-60, below the resolution of doubles near 1
        middle = (low + high) / 2
        hit, miss = math.log(middle), math.log1p(-middle)
        chance = math.fsum(math.exp(choices + count * hit + others * miss) for choices, count, others in ways)
        low, high = (middle, high) if chance < tail else (low, middle)
    return low
