"""Validation of a rule on fresh trials, with exact confidence bounds."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Proportion", "proportion"]


@dataclass(frozen=True, slots=True)
class Proportion:
    """`hits` of `total`, and the Clopper-Pearson 95 % interval of the underlying rate."""

    hits: int
    total: int
    low: float
    high: float

    @property
    def rate(self) -> float:
        """The observed rate; 1 when there was nothing to observe."""
        return self.hits / self.total if self.total else 1.0


def proportion(hits: int, total: int, *, confidence: float = 0.95) -> Proportion:
    """Return a proportion with its exact (Clopper-Pearson) interval.

    Raises:
        MissingExtraError: If scipy is not installed.
    """
    if total == 0:
        return Proportion(0, 0, 0.0, 1.0)
    try:
        from scipy.stats import binomtest
    except ImportError as error:
        from riot_bus.vocabulary.errors import MissingExtraError

        raise MissingExtraError("scipy", "analysis") from error
    interval = binomtest(hits, total).proportion_ci(confidence_level=confidence, method="exact")
    return Proportion(hits, total, float(interval.low), float(interval.high))
