"""Functions of scipy (extra `analysis`) that backchain uses, imported on first use."""

from __future__ import annotations

from riot_bus.vocabulary.errors import needs_extra


def student_reach(freedom: int, *, confidence: float = 0.95) -> float:
    """Return the half width of an interval in standard errors (Student's t).

    Raises:
        MissingExtraError: scipy is not installed.
    """
    with needs_extra("scipy", "analysis"):
        from scipy.special import stdtrit
    return float(stdtrit(freedom, (1 + confidence) / 2))
