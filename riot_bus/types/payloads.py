"""Many payloads in one buffer, and the values of one field of them, as numpy arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Payloads:
    """Many payloads in one buffer.

    Attributes:
        buffer: Bytes such as the decompressed data of a chunk.
        offsets: Offset of each payload in the buffer, shape (n,).
        lengths: Size of each payload in bytes, shape (n,); none extends beyond the buffer.
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
        """Return some of the payloads, by number or by mask."""
        return Payloads(self.buffer, self.offsets[rows], self.lengths[rows])


class Gathered(NamedTuple):
    """A field's values, shape (n,), and where they are valid: invalid floats are NaN, other numbers 0, objects None.

    `doubtful` marks payloads that the type cannot read in bulk; `gather` reads those one by one.
    """

    values: NDArray[Any]
    valid: NDArray[np.bool_]
    doubtful: NDArray[np.bool_] | None = None
