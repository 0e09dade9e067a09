"""Holds rows of an exported table, independent of the file format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Kind = str
"""What a column holds: the name of a numpy type, `text` or `bytes`."""


def text_of(value: Any) -> Any:
    """Return a truth value or bytes as text, everything else unchanged."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value.hex() if isinstance(value, bytes) else value


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Some rows of the table.

    Attributes:
        times: Times of reception, nanoseconds since the Unix epoch, shape (n,).
        publish_times: Times at the source, nanoseconds since the Unix epoch, shape (n,).
        topics: Topic of each message, shape (n,).
        values: Values of each field, shape (n,) each.
        valid: Whether each value is present, shape (n,) for each field.
    """

    times: NDArray[np.int64]
    publish_times: NDArray[np.int64]
    topics: NDArray[Any]
    values: list[NDArray[Any]]
    valid: list[NDArray[np.bool_]]
