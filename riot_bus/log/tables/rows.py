"""Rows of a table that is exported, whatever the format of its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Kind", "Rows"]

Kind = str
"""What a column holds: the name of a numpy type, `text` or `bytes`."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Some rows of the table.

    Attributes:
        times: Reception, nanoseconds since the Unix epoch, shape (n,).
        publish_times: Time at the source, likewise.
        topics: Topic of each message, shape (n,).
        values: Of each field, shape (n,).
        valid: Where there are any, shape (n,) each.
    """

    times: NDArray[np.int64]
    publish_times: NDArray[np.int64]
    topics: NDArray[Any]
    values: list[NDArray[Any]]
    valid: list[NDArray[np.bool_]]
