"""Tables as CSV (RFC 4180), UTF-8 with a header."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from riot_bus.log.tables.rows import Kind, Rows

__all__ = ["CsvWriter"]


class CsvWriter:
    """Writes a table; numbers so that they are read back exactly, a missing value as nothing.

    Args:
        path: File to write.
        kinds: What the columns hold, by name.
    """

    def __init__(self, path: str, kinds: dict[str, Kind]) -> None:
        self._file = open(path, "w", newline="", encoding="utf-8", errors="backslashreplace")  # noqa: SIM115 - see close
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(["time_ns", "publish_time_ns", "topic", *kinds])

    def write(self, rows: Rows) -> None:
        """Append rows."""
        pairs = zip(rows.values, rows.valid, strict=True)
        cells = [_cells(values, valid) for values, valid in pairs]
        columns: list[Iterable[Any]] = [rows.times.tolist(), rows.publish_times.tolist(), rows.topics.tolist(), *cells]
        self._writer.writerows(zip(*columns, strict=True))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def _cells(values: NDArray[Any], valid: NDArray[np.bool_]) -> list[Any]:
    if values.dtype == np.float32:
        cells: list[Any] = [str(value) for value in values]  # the shortest text that is this float32
    else:
        cells = values.tolist()
    if values.dtype in (np.bool_, np.object_):
        cells = [_text(cell) for cell in cells]
    return cells if valid.all() else [cell if there else "" for cell, there in zip(cells, valid.tolist(), strict=True)]


def _text(value: Any) -> Any:
    if isinstance(value, bool):
        return "true" if value else "false"
    return value.hex() if isinstance(value, bytes) else value
