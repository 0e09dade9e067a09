"""What backchain needs of the `analysis` extra; imported on first use."""

from __future__ import annotations

from riot_bus.vocabulary.errors import MissingExtraError

__all__ = ["student_reach"]


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
