"""Writes tables as CSV (RFC 4180), UTF-8 with a header."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

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


_FORMULA = ("=", "+", "-", "@")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-](inf|nan)")


class CsvWriter:
    r"""Writer of CSV tables: numbers can be read back exactly, and a missing value is an empty cell.

    Texts of a log may come from anyone. Texts that begin with `=`, `+`, `-` or `@` and are not numbers get a leading
    `'`, so that a spreadsheet does not take them for formulas. Control characters are escaped, as in `\x1b`, so that
    a terminal does not obey them.
    """

    def __init__(self, path: str, kinds: dict[str, Kind], *, raw: bool = False) -> None:
        self._harmless: Callable[[Any], Any] = (lambda value: value) if raw else _harmless
        self._file = open(path, "w", newline="", encoding="utf-8", errors="backslashreplace")  # noqa: SIM115 - see close
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(["time_ns", "publish_time_ns", "topic", *map(self._harmless, kinds)])

    def write(self, rows: Rows) -> None:
        """Append rows."""
        pairs = zip(rows.values, rows.valid, strict=True)
        cells = [self._cells(values, valid) for values, valid in pairs]
        topics = map(self._harmless, rows.topics.tolist())
        columns: list[Iterable[Any]] = [rows.times.tolist(), rows.publish_times.tolist(), topics, *cells]
        self._writer.writerows(zip(*columns, strict=True))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def _cells(self, values: NDArray[Any], valid: NDArray[np.bool_]) -> list[Any]:
        if values.dtype == np.float32:
            cells: list[Any] = [str(value) for value in values]  # the shortest text that is this float32
        else:
            cells = values.tolist()
        if values.dtype in (np.bool_, np.object_):
            cells = [self._harmless(text_of(cell)) for cell in cells]
        there = valid.tolist()
        return cells if all(there) else [cell if known else "" for cell, known in zip(cells, there, strict=True)]


def _harmless(value: Any) -> Any:
    return _harmless_text(value) if isinstance(value, str) else value


@lru_cache(maxsize=1 << 12)
def _harmless_text(value: str) -> str:
    value = escape_control_chars(value, keep="\n")
    return f"'{value}" if value.startswith(_FORMULA) and not _NUMBER.fullmatch(value) else value
