"""Many payloads in one buffer, and the values of one field of them, as numpy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

__all__ = ["Gathered", "Payloads"]


@dataclass(frozen=True, slots=True, eq=False)
class Payloads:
    """Many payloads in one buffer.

    Attributes:
        buffer: Such as the decompressed data of a chunk.
        offsets: Where each payload begins, shape (n,).
        lengths: How many bytes each has, shape (n,); none goes beyond the buffer.
    """

    buffer: bytes
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets)

    def __iter__(self) -> Iterator[bytes]:
        buffer = self.buffer
        for start, length in zip(self.offsets.tolist(), self.lengths.tolist(), strict=True):
            yield buffer[start : start + length]

    def take(self, rows: NDArray[Any]) -> Payloads:
        """Return some of them, by number or by mask."""
        return Payloads(self.buffer, self.offsets[rows], self.lengths[rows])


class Gathered(NamedTuple):
    """A field's values, shape (n,), and where there are any: elsewhere a float is NaN, a number 0, an object None.

    `doubtful` marks payloads of which the type cannot tell in bulk; `gather` reads those one by one.
    """

    values: NDArray[Any]
    valid: NDArray[np.bool_]
    doubtful: NDArray[np.bool_] | None = None
