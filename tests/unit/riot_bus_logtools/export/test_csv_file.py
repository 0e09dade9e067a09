from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riot_bus_logtools.export.csv_file import CsvWriter, Rows


def rows(values: list[object], kind: object) -> Rows:
    count = len(values)
    times = np.arange(count, dtype=np.int64)
    valid = np.ones(count, np.bool_)
    valid[0] = False
    return Rows(times, times, np.full(count, "/t", object), [np.array(values, kind)], [valid])  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("values", "kind", "cells"),
    [
        ([0.0, 0.1, float("nan")], np.float32, ["", "0.1", "nan"]),
        ([1, 2], np.int64, ["", "2"]),
        ([True, False], np.bool_, ["", "false"]),
        (["x", "=1+1", "-1", b"\x01"], object, ["", "'=1+1", "-1", "01"]),
        (["x", "\x1b[0m"], object, ["", "\\x1b[0m"]),
    ],
)
def test_cells(values: list[object], kind: object, cells: list[str], tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    writer = CsvWriter(str(path), {"v": "any"})
    writer.write(rows(values, kind))
    writer.close()
    head, *lines = path.read_text().splitlines()
    assert head == "time_ns,publish_time_ns,topic,v"
    assert [line.split(",", 3)[3] for line in lines] == cells


def test_raw_texts_are_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    writer = CsvWriter(str(path), {"=v": "text"}, raw=True)
    writer.write(rows(["x", "=1"], object))
    writer.close()
    assert path.read_text().splitlines()[0].endswith(",=v")
    assert path.read_text().splitlines()[2].endswith(",=1")
