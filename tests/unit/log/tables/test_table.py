"""Columns are what `LogReader` and `read` give message by message."""

import io
import json
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from riot_bus.log import columns, iter_columns
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.table import column_parts
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.types.json_type import JsonType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message
from tests.log_mutants import COUNT, START, foreign, ours

X, Y = "/twist:x", "/twist:y"
TEXT = "/string:data"
KINDS = ("zstd", "lz4", "plain", "unchunked")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mcap"


def saved(path, data):
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("threads", [0, 1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_fields_of_somebody_elses_file(path, kind, threads):
    found = columns(saved(path, foreign(kind)), [X, Y, TEXT], threads=threads)
    numbers = np.arange(0, COUNT, 2)
    assert list(found) == [X, Y, TEXT]
    assert found[X].values.tolist() == numbers.tolist()
    assert found[Y].values.tolist() == (-numbers).tolist()
    assert found[X].values.dtype == np.float64
    assert found[X].times.tolist() == found[X].publish_times.tolist() == (START + numbers).tolist()
    assert found[X].times.dtype == np.int64
    assert found[X].valid.all()
    assert found[X].keys == ("/twist",)
    assert not found[X].key.any()
    assert found[X].field == "x"
    assert found[TEXT].values.tolist() == [f"{n:04}" for n in range(1, COUNT, 2)]
    assert not found.loss


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_fields_of_our_own_file(path, compression):
    found = columns(
        saved(path, ours(compression)), ["rover/a:x", "rover/b:name", "rover/b:list[1]", "rover/a:len(list)"]
    )
    assert found["rover/a:x"].values.tolist() == list(range(0, COUNT, 2))
    assert found["rover/a:x"].values.dtype == np.int64
    assert found["rover/b:name"].values.tolist() == [f"n{n}" for n in range(1, COUNT, 2)]
    assert found["rover/b:list[1]"].values.tolist() == [2.5] * (COUNT // 2)
    assert found["rover/a:len(list)"].values.tolist() == [2] * (COUNT // 2)
    assert (found["rover/a:x"].times - found["rover/a:x"].publish_times == 5).all()


def test_several_keys(path):
    found = columns(saved(path, ours("zstd")), ["rover/*:x"])["rover/*:x"]
    assert found.values.tolist() == list(range(COUNT))
    assert [found.keys[number] for number in found.key] == [f"rover/{'ab'[n % 2]}" for n in range(COUNT)]
    assert len(found) == COUNT


@pytest.mark.parametrize("kind", KINDS)
def test_time_and_condition(path, kind):
    saved(path, foreign(kind))
    text = f"{X} where y <= -10 and x != 14"
    found = columns(path, [text, TEXT], start=START + 4, end=START + 20)
    assert found[text].values.tolist() == [10, 12, 16, 18]
    assert found[text].times.tolist() == [START + 10, START + 12, START + 16, START + 18]
    assert found[TEXT].values.tolist() == ["0005", "0007", "0009", "0011", "0013", "0015", "0017", "0019"]


def test_conditions_on_what_is_missing_or_of_another_kind_choose_nothing(path):
    documents = [{"x": 1, "a": 1}, {"x": 2}, {"x": 3, "a": "text"}, {"a": 1}]
    with LogWriter(path) as writer:
        for n, document in enumerate(documents):
            writer.write(Message(n, "k", json.dumps(document).encode(), encoding="application/json"))
    found = columns(path, ["k:x where a == 1"])["k:x where a == 1"]
    assert (found.times.tolist(), found.valid.tolist()) == ([0, 3], [True, False])


SCALAR = st.none() | st.booleans() | st.integers(-(1 << 64), 1 << 64) | st.floats(allow_nan=False) | st.text(max_size=3)
ROW = st.tuples(st.sampled_from(["a", "b/c"]), st.integers(0, 20), SCALAR)


@settings(deadline=None)
@given(st.lists(ROW, max_size=40), st.integers(60, 400), st.sampled_from([None, 3, 9]), st.sampled_from([None, 12]))
def test_columns_are_what_is_read_one_by_one(tmp_path_factory, rows, chunk_bytes, start, end):
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=chunk_bytes)) as writer:
        for key, time, value in rows:
            body = json.dumps({"v": value} if value is not None else {}).encode()
            writer.write(Message(time, key, body, encoding="application/json"))
    topics = sorted({key for key, _, _ in rows})
    expected = {topic: [] for topic in topics}
    with LogReader(path) as reader:
        for message in reader.messages(start=start, end=end):
            try:
                value = JsonType().read(message.payload, "v")
            except PayloadError:
                value = None
            expected[message.key].append((message.time, value))
    if not topics:
        return
    selectors = [f"{topic}:v" for topic in topics]
    whole = columns(path, selectors, start=start, end=end, registry=TypeRegistry())
    parts = list(iter_columns(path, selectors, start=start, end=end, threads=1, registry=TypeRegistry()))
    for topic, selector in zip(topics, selectors, strict=True):
        assert listed([whole[selector]]) == expected[topic]
        assert listed([part[selector] for part in parts]) == expected[topic]
    assert not whole.loss
    assert not parts[-1].loss


def listed(found):
    rows = []
    for column in found:
        values = zip(column.times.tolist(), column.values.tolist(), column.valid.tolist(), strict=True)
        rows += [(time, value if valid else None) for time, value, valid in values]
    return rows


def test_pieces_are_small_and_come_by_time(path):
    with LogWriter(path, LogSettings(chunk_bytes=2000, compression="none")) as writer:
        for n in range(3000):
            writer.write(Message(n, "a", b'{"x": %d}' % n, encoding="application/json"))
    pieces = [part["a:x"] for part in iter_columns(path, ["a:x"])]
    assert np.concatenate([piece.values for piece in pieces]).tolist() == list(range(3000))
    assert max(map(len, pieces)) < 100


def test_chunks_that_overlap_beyond_memory_come_unsorted_and_are_counted(path):
    buffer = io.BytesIO()
    writer = Writer(buffer, chunk_size=2000, compression=CompressionType.NONE)
    writer.start()
    channel = writer.register_channel("a", "json", 0)
    for n in range(3000):
        time = 0 if n % 50 == 0 else 3000 - n
        writer.add_message(channel, time, b'{"x": %d}' % n, time)
    writer.finish()
    saved(path, buffer.getvalue())
    whole = columns(path, ["a:x"])["a:x"]
    assert (np.diff(whole.times) >= 0).all()
    parts = list(iter_columns(path, ["a:x"], memory=20_000))
    assert sum(len(part["a:x"]) for part in parts) == 3000
    assert parts[-1].loss.unsorted > 0
    assert not list(iter_columns(path, ["a:x"]))[-1].loss


def test_more_than_memory_is_refused(path):
    with LogWriter(path, LogSettings(chunk_bytes=10_000)) as writer:
        for n in range(5000):
            writer.write(Message(n, "a", b'{"x": 1}', encoding="application/json"))
    with pytest.raises(ConfigError, match="memory = 100000") as caught:
        columns(path, ["a:x"], memory=100_000)
    assert "iter_columns" in (caught.value.hint or "")
    assert sum(len(part["a:x"]) for part in iter_columns(path, ["a:x"], memory=100_000)) == 5000


def test_a_chunk_beyond_memory_is_counted(path):
    with LogWriter(path, LogSettings(chunk_bytes=1 << 20)) as writer:
        for n in range(3):
            writer.write(Message(n, "a", b'{"x": 1, "y": "%s"}' % (b"z" * (1 << 20)), encoding="application/json"))
    found = columns(path, ["a:x"], memory=1 << 20)
    assert len(found["a:x"]) == 0
    assert found.loss.chunks == 3
    assert len(columns(path, ["a:x"])["a:x"]) == 3


LIMITED = """
import resource, sys
from riot_bus.log import columns, iter_columns
from riot_bus_logtools.export.export import export_table
from riot_bus.log.info import log_info
log, out, limit = sys.argv[1], sys.argv[2], 64 << 20
columns(sys.argv[3], ["a:x"])  # for the imports
pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, [pages * resource.getpagesize() + 2 * limit] * 2)
assert columns(log, ["a:x"], memory=limit, threads=1)["a:x"].values.tolist() == list(range(240))
assert sum(len(part["a:x"]) for part in iter_columns(log, ["a:x"], memory=limit, threads=1)) == 240
assert export_table(log, ["a:x"], out, memory=limit).rows == 240
"""


def test_memory_is_bounded_on_a_file_larger_than_the_limit(tmp_path):
    small, path = tmp_path / "small.mcap", tmp_path / "a.mcap"
    with LogWriter(small) as writer:
        writer.write(Message(1, "a", b'{"x": 1}', encoding="application/json"))
    padding = b"z" * (1 << 20)
    with LogWriter(path, LogSettings(compression="none")) as writer:
        for n in range(240):
            writer.write(Message(n, "a", b'{"x": %d, "y": "%s"}' % (n, padding), encoding="application/json"))
    assert path.stat().st_size > 3 * (64 << 20)
    command = [sys.executable, "-c", LIMITED, str(path), str(tmp_path / "a.csv"), str(small)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_damage_is_counted_and_the_rest_is_read(path):
    raw = bytearray(foreign("plain"))
    raw[raw.index(b"0031\0")] ^= 1
    found = columns(saved(path, bytes(raw)), [TEXT])
    assert found.loss.chunks == 1
    assert 20 < len(found[TEXT]) < COUNT // 2
    cut = foreign("zstd")[:-400]
    found = columns(saved(path, cut), [X])
    assert found.loss.unfinished


def test_payloads_that_do_not_decode_have_no_value(path):
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="ros2")
    schema = writer.register_schema("std_msgs/msg/Int8", "ros2msg", b"int8 data")
    channel = writer.register_channel("/a", "cdr", schema)
    for n, payload in enumerate([b"\0\1\0\0\x05", b"", b"\0\1\0\0", b"\0\0\0\0\xff", b"\0\x0a\0\0\x05"]):
        writer.add_message(channel, n, payload, n)
    writer.finish()
    found = columns(saved(path, buffer.getvalue()), ["/a:data"])["/a:data"]
    assert found.valid.tolist() == [True, False, False, True, False]
    assert found.values.tolist() == [5, 0, 0, -1, 0]
    assert found.values.dtype == np.int8


def test_times_beyond_2262_are_counted(path):
    with LogWriter(path) as writer:
        for time in (5, 1 << 63, (1 << 64) - 1):
            writer.write(Message(time, "a", b'{"x": 1}', encoding="application/json"))
    found = columns(path, ["a:x"])
    assert found["a:x"].times.tolist() == [5]
    assert found.loss.messages == 2


def test_type_given_by_the_user(path):
    from riot_bus.log.tables.plan import log_registry

    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start()
    channel = writer.register_channel("/a", "", 0)
    writer.add_message(channel, 1, b"\0\1\0\0" + struct.pack("<ddd", 1.5, 2, 3), 1)
    writer.finish()
    saved(path, buffer.getvalue())
    assert not columns(path, ["/a:x"])["/a:x"].valid.any()
    with LogReader(path) as reader:
        registry = log_registry(reader, declared={"/a": "geometry_msgs/msg/Vector3"})
        assert columns(path, ["/a:x"], registry=registry)["/a:x"].values.tolist() == [1.5]
        assert [part["/a:x"].values.tolist() for part in column_parts(reader, ["/a:x"], registry=registry)] == [
            [1.5],
            [],
        ]


@pytest.mark.parametrize(
    ("selectors", "error", "problem", "hint"),
    [
        ([], ConfigError, "no field", "name at least one"),
        (["/twist"], ConfigError, "names no field", "riot types LOG"),
        (["/twst:x"], ConfigError, "no topic '/twst'", "/twist"),
        (["/twist:xx"], PayloadError, "no field 'xx'", "'x'"),
        (["/twist:x[*]"], ConfigError, "many fields", "name one element"),
        (["/twist:x where z"], ConfigError, "expected", None),
        (["/twist:x where nothing == 1"], PayloadError, "no field 'nothing'", None),
        (["**:nothing"], PayloadError, "no field 'nothing'", None),
    ],
)
def test_what_cannot_be_is_refused(path, selectors, error, problem, hint):
    saved(path, foreign("zstd"))
    with pytest.raises(error, match=problem) as caught:
        columns(path, selectors)
    assert hint is None or hint in (caught.value.hint or "")


def test_wildcards_take_the_topics_that_have_the_field(path):
    found = columns(saved(path, foreign("zstd")), ["/**:x"])["/**:x"]
    assert found.keys == ("/twist",)
    assert len(found) == COUNT // 2


def test_a_type_without_definition_is_named(path):
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="ros2")
    channel = writer.register_channel("/a", "cdr", writer.register_schema("p/msg/T", "ros2msg", b""))
    writer.add_message(channel, 1, bytes(9), 1)
    writer.finish()
    with pytest.raises(ConfigError, match="'p/msg/T' of '/a' is not known") as caught:
        columns(saved(path, buffer.getvalue()), ["/a:x"])
    assert "--msg" in (caught.value.hint or "")


def test_originals_are_no_messages(path):
    with LogWriter(path) as writer:
        writer.write(Message(1, "a", b'{"x": 1}', encoding="application/json"), role="original")
        writer.write(Message(1, "a", b'{"x": 2}', encoding="application/json"))
    assert columns(path, ["a:x"])["a:x"].values.tolist() == [2]


def test_the_package_gives_what_it_says():
    import riot_bus.log

    for name in riot_bus.log.__all__:
        assert getattr(riot_bus.log, name).__name__ == name
    with pytest.raises(AttributeError, match="nothing"):
        _ = riot_bus.log.nothing
