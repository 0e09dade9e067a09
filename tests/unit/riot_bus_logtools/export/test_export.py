"""Tables in CSV and Parquet hold what columns hold."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, MissingExtraError, install_hint
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.export.export import export_table
from tests.log_mutants import COUNT, START, foreign

FIELDS = ["/twist:x", "/twist:y", "/string:data"]


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(foreign("zstd"))
    return path


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def json_log(path, documents, *, key="k"):
    with LogWriter(path, LogSettings(chunk_bytes=200)) as writer:
        for n, document in enumerate(documents):
            body = document if isinstance(document, bytes) else json.dumps(document).encode()
            writer.write(Message(START + n, key, body, encoding="application/json"))
    return path


def test_csv(log, tmp_path):
    out = tmp_path / "a.csv"
    done = export_table(log, FIELDS, out)
    assert (done.rows, done.values) == (COUNT, dict.fromkeys(FIELDS, COUNT // 2))
    assert not done.loss
    rows = rows_of(out)
    assert list(rows[0]) == ["time_ns", "publish_time_ns", "topic", *FIELDS]
    for n, row in enumerate(rows):
        even = n % 2 == 0
        assert row["time_ns"] == row["publish_time_ns"] == str(START + n)
        assert row["topic"] == ("/twist" if even else "/string")
        assert (row["/twist:x"], row["/string:data"]) == ((str(float(n)), "") if even else ("", f"{n:04}"))


def test_parquet(log, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "a.parquet"
    export_table(log, FIELDS, out)
    table = parquet.read_table(out)
    assert table.num_rows == COUNT
    types = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert types == {
        "time": "timestamp[ns, tz=UTC]",
        "publish_time": "timestamp[ns, tz=UTC]",
        "topic": "dictionary<values=string, indices=int32, ordered=0>",
        "/twist:x": "double",
        "/twist:y": "double",
        "/string:data": "string",
    }
    assert table["time"].cast("int64").to_pylist() == [START + n for n in range(COUNT)]
    assert table["/twist:x"].to_pylist() == [float(n) if n % 2 == 0 else None for n in range(COUNT)]
    assert table["/string:data"].to_pylist() == [f"{n:04}" if n % 2 else None for n in range(COUNT)]
    assert table["topic"].to_pylist() == [("/twist", "/string")[n % 2] for n in range(COUNT)]


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([1, 2, None], "int64"),
        ([1, 2.5], "double"),
        ([True, False], "bool"),
        (["a", 'é\n,"'], "string"),
        ([1, "a", True], "string"),
        ([1 << 63], "double"),
        ([], "double"),
    ],
)
def test_types_of_json_fields(tmp_path, values, kind):
    parquet = pytest.importorskip("pyarrow.parquet")
    log = json_log(tmp_path / "a.mcap", [{"v": value, "pad": "x" * 60} for value in values] + [{}])
    export_table(log, ["k:v"], tmp_path / "a.parquet")
    table = parquet.read_table(tmp_path / "a.parquet")
    assert str(table.schema.field("k:v").type) == kind
    found = table["k:v"].to_pylist()
    expected = [*values, None]
    if kind == "string":
        expected = [each if each is None else str(each).lower() if each is True else str(each) for each in expected]
    assert found == expected
    export_table(log, ["k:v"], tmp_path / "a.csv")
    texts = [row["k:v"] for row in rows_of(tmp_path / "a.csv")]
    assert len(texts) == len(expected)
    if kind == "string" and len(values) == 2:
        assert texts[:-1] == values


def test_numbers_are_read_back_exactly(tmp_path):
    values = [0.1, 1e-320, 1.7976931348623157e308, -0.0, 3.141592653589793]
    log = json_log(tmp_path / "a.mcap", [{"v": value} for value in values])
    export_table(log, ["k:v"], tmp_path / "a.csv")
    found = [float(row["k:v"]) for row in rows_of(tmp_path / "a.csv")]
    assert found == values
    assert math.copysign(1, found[3]) == -1


def test_float32_is_written_short(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float32", "ros2msg", b"float32 data")
        channel = writer.register_channel("/a", "cdr", schema)
        for n, value in enumerate([0.1, np.nan, np.inf]):
            writer.add_message(channel, n, b"\0\1\0\0" + np.float32(value).tobytes(), n)
        writer.finish()
    export_table(tmp_path / "a.mcap", ["/a:data"], tmp_path / "a.csv")
    assert [row["/a:data"] for row in rows_of(tmp_path / "a.csv")] == ["0.1", "nan", "inf"]


def test_messages_of_one_time_keep_their_rows(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path) as writer:
        for n in range(6):
            writer.write(Message(5, "ab"[n % 2], b'{"v": %d, "w": %d}' % (n, -n), encoding="application/json"))
    export_table(path, ["a:v", "b:v", "a:w"], tmp_path / "a.csv")
    rows = [(row["topic"], row["a:v"], row["b:v"], row["a:w"]) for row in rows_of(tmp_path / "a.csv")]
    assert rows == [
        ("a", "0", "", "0"),
        ("b", "", "1", ""),
        ("a", "2", "", "-2"),
        ("b", "", "3", ""),
        ("a", "4", "", "-4"),
        ("b", "", "5", ""),
    ]


def test_conditions_and_names_of_columns(log, tmp_path):
    export_table(log, ["/twist:x where y < -50", "/twist:y"], tmp_path / "a.csv")
    rows = rows_of(tmp_path / "a.csv")
    assert list(rows[0])[3:] == ["/twist:x", "/twist:y"]
    assert [row["/twist:x"] for row in rows if row["/twist:x"]] == ["52.0", "54.0", "56.0", "58.0"]
    assert len(rows) == COUNT // 2
    two = ["/twist:x where y < -50", "/twist:x"]
    export_table(log, two, tmp_path / "b.csv")
    assert list(rows_of(tmp_path / "b.csv")[0])[3:] == two


def test_time(log, tmp_path):
    done = export_table(log, FIELDS, tmp_path / "a.csv", start=START + 10, end=START + 12)
    assert done.rows == 2


def test_many_rows(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    log = tmp_path / "a.mcap"
    with LogWriter(log) as writer:
        for n in range(150_000):
            writer.write(Message(n, "k", b"%d" % n, encoding="application/json"))
    done = export_table(log, ["k:value"], tmp_path / "a.parquet")
    assert done.rows == 150_000
    assert parquet.read_table(tmp_path / "a.parquet")["k:value"].to_pylist() == list(range(150_000))


def test_damage_is_said(log, tmp_path):
    log.write_bytes(foreign("zstd")[:-300])
    done = export_table(log, FIELDS, tmp_path / "a.csv")
    assert done.loss.unfinished
    assert done.rows > 0


def test_nothing_is_overwritten_without_being_told(log, tmp_path):
    out = tmp_path / "a.csv"
    out.write_text("mine")
    with pytest.raises(ConfigError, match="exists") as caught:
        export_table(log, FIELDS, out)
    assert "--force" in (caught.value.hint or "")
    assert out.read_text() == "mine"
    export_table(log, FIELDS, out, force=True)
    assert len(rows_of(out)) == COUNT


def test_after_an_error_the_old_file_is_still_there(log, tmp_path):
    out = tmp_path / "a.csv"
    out.write_text("mine")
    with pytest.raises(ConfigError, match="no topic"):
        export_table(log, ["/nothing:x"], out, force=True)
    assert out.read_text() == "mine"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.csv", "a.mcap"]


@pytest.mark.parametrize(("name", "hint"), [("a.xlsx", ".csv"), ("a", ".csv"), ("a.parqet", ".parquet")])
def test_other_kinds_of_files(log, tmp_path, name, hint):
    with pytest.raises(ConfigError, match="unknown kind") as caught:
        export_table(log, FIELDS, tmp_path / name)
    assert hint in (caught.value.hint or "")


def test_folder_that_is_not_there(log, tmp_path):
    with pytest.raises(EnvironmentFaultError, match="cannot write"):
        export_table(log, FIELDS, tmp_path / "none" / "a.csv")


def test_the_disk_is_full(log, tmp_path, monkeypatch):
    from riot_bus_logtools.export import csv_file as export_csv

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export_csv.CsvWriter, "write", full)
    with pytest.raises(EnvironmentFaultError, match="No space left"):
        export_table(log, FIELDS, tmp_path / "a.csv")
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


def test_without_pyarrow(log, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="pyarrow") as caught:
        export_table(log, FIELDS, tmp_path / "a.parquet")
    assert install_hint("export") in (caught.value.hint or "")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("=cmd|' /C calc'!A0", "'=cmd|' /C calc'!A0"),
        ("+1+1", "'+1+1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("-2+3", "'-2+3"),
        ("-2.5e-3", "-2.5e-3"),
        ("+7", "+7"),
        ("-inf", "-inf"),
        ("a=b", "a=b"),
        ("\x1b[31mred\x07", "\\x1b[31mred\\x07"),
        ("\t=1", "\\t=1"),
        ("two\nlines", "two\nlines"),
        ("", ""),
    ],
)
def test_texts_of_strangers_do_no_harm(tmp_path: Path, text: str, shown: str) -> None:
    log, out = tmp_path / "a.mcap", tmp_path / "a.csv"
    with LogWriter(log) as writer:
        writer.write(Message(1, "t", json.dumps({"s": text}).encode(), encoding="application/json"))
    for raw, expected in ((False, shown), (True, text)):
        export_table(log, ["t:s"], out, force=True, raw=raw)
        with open(out, newline="", encoding="utf-8") as file:
            assert list(csv.reader(file))[1][3] == expected
