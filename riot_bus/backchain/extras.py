"""Functions of scipy (extra `analysis`) that backchain uses, imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import needs_extra

if TYPE_CHECKING:
    from collections.abc import Sequence


def strong_components(count: int, arrows: Sequence[tuple[int, int]]) -> list[int]:
    """Return the number of the strongly connected component of each node.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    with needs_extra("scipy", "analysis"):
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
    rows, columns = ([pair[end] for pair in arrows] for end in (0, 1))
    matrix = coo_array(([1.0] * len(arrows), (rows, columns)), shape=(count, count))
    labels: list[int] = connected_components(matrix, directed=True, connection="strong")[1].tolist()
    return labels


def student_reach(freedom: int, *, confidence: float = 0.95) -> float:
    """Return the half width of an interval in standard errors (Student's t).

    Args:
        freedom: Degrees of freedom, at least 1.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    with needs_extra("scipy", "analysis"):
        from scipy.special import stdtrit
    return float(stdtrit(freedom, (1 + confidence) / 2))
