"""What backchain needs of the `analysis` extra; imported on first use."""

from __future__ import annotations

from riot_bus.vocabulary.errors import MissingExtraError

__all__ = ["clopper_pearson", "student_reach"]


def student_reach(freedom: int) -> float:
    """Return the half width of a 95 % interval in standard errors (Student's t).

    Args:
        freedom: Degrees of freedom, at least 1.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    try:
        from scipy.special import stdtrit
    except ImportError:
        raise MissingExtraError("scipy", "analysis") from None
    return float(stdtrit(freedom, 0.975))


def clopper_pearson(hits: int, trials: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a rate seen as `hits` of `trials`.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    try:
        from scipy.special import betaincinv
    except ImportError:
        raise MissingExtraError("scipy", "analysis") from None
    low = float(betaincinv(hits, trials - hits + 1, 0.025)) if hits else 0.0
    high = float(betaincinv(hits + 1, trials - hits, 0.975)) if hits < trials else 1.0
    return low, high
