"""Types and ranges of all fields are those of the messages."""

import io
import math
import struct

import pytest
from mcap.writer import Writer

from riot_bus.log.reader import LogReader
from riot_bus.log.tables.plan import log_registry, topic_types
from riot_bus.log.tables.ranges import field_ranges
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from tests.log_mutants import COUNT, foreign, ours

MIXED = (
    b"string name\nfloat32[] values\nuint8[3] fixed\nP[] points\nbool flag\n"
    + b"=" * 80
    + b"\nMSG: p/P\nint16 x\nstring s\n"
)


def by_path(topic):
    return {each.path: each for each in topic.fields}


def ranges_of(path, **options):
    with LogReader(path) as reader:
        return field_ranges(reader, **options)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mcap"


def test_numbers_and_text(path):
    path.write_bytes(foreign("zstd"))
    text, twist = ranges_of(path)
    assert (twist.topic, twist.type, twist.count, twist.unreadable) == (
        "/twist",
        "geometry_msgs/msg/Vector3",
        COUNT // 2,
        0,
    )
    found = by_path(twist)
    assert list(found) == ["x", "y", "z"]
    assert (found["x"].low, found["x"].high, found["x"].count, found["x"].nan) == (0.0, 58.0, COUNT // 2, 0)
    assert (found["y"].low, found["y"].high) == (-58.0, 0.0)
    assert by_path(text)["data"].examples == ["0001", "0003", "0005", "0007"]


def message(values, points, flag):
    body = (
        struct.pack("<I", 2)
        + b"n\0"
        + bytes(2)
        + struct.pack("<I", len(values))
        + struct.pack(f"<{len(values)}f", *values)
    )
    body += bytes([7, 0, 9]) + bytes(-(len(body) + 3) % 4) + struct.pack("<I", len(points))
    for number in points:
        body += bytes(-len(body) % 2) + struct.pack("<h", number)
        body += bytes(-len(body) % 4) + struct.pack("<I", 2) + b"s\0"
    return b"\0\1\0\0" + body + bytes([flag])


def test_arrays(path):
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="ros2")
    channel = writer.register_channel("/m", "cdr", writer.register_schema("p/msg/M", "ros2msg", MIXED))
    bodies = [
        message([1.5, math.nan, -3], [5, -6], 1),
        message([], list(range(30)), 0),
        message([math.inf], [], 1),
        b"\0\1\0\0",
    ]
    for n, body in enumerate(bodies):
        writer.add_message(channel, n, body, n)
    writer.finish()
    path.write_bytes(buffer.getvalue())
    (topic,) = ranges_of(path)
    assert (topic.count, topic.unreadable) == (4, 1)
    found = by_path(topic)
    values = found["values[*]"]
    assert (values.count, values.nan, values.low, values.high, values.partial) == (4, 1, -3.0, math.inf, False)
    assert (found["len(values)"].low, found["len(values)"].high) == (0, 3)
    assert (found["fixed[*]"].count, found["fixed[*]"].low, found["fixed[*]"].high) == (9, 0, 9)
    points = found["points[*].x"]
    assert (points.count, points.low, points.high, points.partial) == (18, -6, 15, True)
    assert found["points[*].s"].examples == ["s"]
    assert (found["flag"].low, found["flag"].high, found["flag"].type) == (False, True, "bool")


def test_json(path):
    with LogWriter(path) as writer:
        for n, body in enumerate([b'{"a": 1, "l": [1, 2]}', b'{"a": 2.5, "l": [7]}', b'{"a": "x"}', b"not json"]):
            writer.write(Message(n, "k", body, encoding="application/json"))
    (topic,) = ranges_of(path)
    assert (topic.count, topic.unreadable, topic.type) == (4, 1, "json")
    found = by_path(topic)
    assert found["a"].type == "int64|float64|string"
    assert (found["a"].count, found["a"].low, found["a"].high, found["a"].examples) == (3, 1, 2.5, ["x"])
    assert (found["l[*]"].count, found["l[*]"].low, found["l[*]"].high) == (3, 1, 7)


def test_selection_and_progress(path):
    path.write_bytes(ours("zstd"))
    told = []
    (topic,) = ranges_of(path, topics=["rover/a"], progress=lambda done, total: told.append((done, total)))
    assert topic.topic == "rover/a"
    assert by_path(topic)["x"].high == COUNT - 2
    assert told == sorted(told)
    assert 0 < told[-1][0] <= told[-1][1] == path.stat().st_size


def test_unknown_types_have_no_fields(path):
    with LogWriter(path) as writer:
        writer.write(Message(1, "k", b"\xff\xff"))
    (topic,) = ranges_of(path)
    assert (topic.count, topic.fields, topic.type) == (1, [], "")


def test_types_of_topics(path):
    with LogWriter(path, registry=TypeRegistry(load_adapters(), declared={"v": "geometry_msgs/msg/Vector3"})) as writer:
        writer.write(Message(1, "v", b"\0\1\0\0" + bytes(24)))
        writer.write(Message(2, "j", b'{"a": [{"b": 1}]}', encoding="application/json"))
        writer.write(Message(3, "?", b"\xff"))
    with LogReader(path) as reader:
        found = dict(topic_types(reader, log_registry(reader)))
        assert [name for name, _ in topic_types(reader, log_registry(reader), ["j"])] == ["j"]
    assert [(each.path, each.type) for each in found["v"].fields] == [
        ("x", "float64"),
        ("y", "float64"),
        ("z", "float64"),
    ]
    assert [(each.path, each.type) for each in found["j"].fields] == [("len(a)", "uint32"), ("a[*].b", "int64")]
    assert (found["?"].name, found["?"].fields) == ("", ())
