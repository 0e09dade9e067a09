from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riot_bus_logtools.export.csv_file import Rows
from riot_bus_logtools.export.parquet_file import ParquetTableWriter

parquet = pytest.importorskip("pyarrow.parquet")


def test_types_and_missing_values_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    writer = ParquetTableWriter(str(path), {"i": "uint8", "f": "float64", "t": "text", "b": "bytes"})
    times, valid = np.array([1, 2]), np.array([True, False])
    columns = [
        np.array([1, 0], np.uint8),
        np.array([0.5, 0]),
        np.array(["x", None], object),
        np.array([b"y", None], object),
    ]
    writer.write(Rows(times, times, np.array(["/t", "/t"], object), columns, [valid] * 4))
    empty = np.zeros(0, np.int64)
    writer.write(Rows(empty, empty, empty, [], []))
    writer.close()
    first, second = parquet.read_table(path).drop(["time", "publish_time"]).to_pylist()
    assert first == {"topic": "/t", "i": 1, "f": 0.5, "t": "x", "b": b"y"}
    assert second == {"topic": "/t", "i": None, "f": None, "t": None, "b": None}
