from __future__ import annotations

import json
import math
import struct

import pytest

from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison import fields
from riot_bus_logtools.comparison.fields import ATTACHMENT, KIND, MOST_ELEMENTS, PAYLOAD, Shapes, differing
from riot_bus_logtools.comparison.tolerances import tolerances_of
from tests.unit.riot_bus_logtools.comparison.recordings import said

REGISTRY = TypeRegistry(
    load_adapters(), declared={"twist": "geometry_msgs/msg/Twist", "bytes": "std_msgs/msg/UInt8MultiArray"}
)


def rules(*texts: str):
    return tolerances_of(texts).of_topic(lambda text: True)


def changes(a, b, *texts: str):
    """What differs between two messages: path, both values, and whether it is allowed."""
    found, shapes = rules(*texts), Shapes(rules(*texts))
    one, other = (shapes.read(each if isinstance(each, Message) else said(each)[0], REGISTRY) for each in (a, b))
    return [(each.path, each.before, each.after, each.allowed) for each in differing(one, other, found)]


def test_equal_messages_have_no_changes():
    row = {"x": 1.5, "deep": {"list": [1, "a", True]}}
    assert changes(row, row) == []
    assert changes({"x": 1}, {"x": 1.0}) == []
    assert changes({"x": 0.0}, {"x": -0.0}) == []


@pytest.mark.parametrize(
    ("a", "b"), [(True, 1), (False, 0), ("1", 1), (1.0, math.nan), ("true", True), (math.inf, -math.inf)]
)
def test_values_of_different_kinds_differ(a, b):
    ((path, before, after, allowed),) = changes({"x": a}, {"x": b}, "a:x=1")
    assert (path, allowed) == ("x", False)
    assert [type(before), type(after)] == [type(a), type(b)]


def test_nan_equals_nan():
    assert changes({"x": math.nan, "y": 1}, {"x": math.nan, "y": 1}) == []


def test_what_is_tolerated_is_told_too():
    assert changes({"x": 1.0, "n": 7}, {"x": 1.25, "n": 9}, "a:x=0.5", "a:n=ignore") == [
        ("x", 1.0, 1.25, True),
        ("n", 7, 9, True),
    ]
    assert changes({"x": 1.0}, {"x": 1.25}, "a:x=0.2") == [("x", 1.0, 1.25, False)]


def test_times_are_left_apart():
    assert changes({"header": {"stamp": 3}}, {"header": {"stamp": 4}}) == [("header.stamp", 3, 4, True)]


def test_fields_that_one_message_lacks():
    assert changes({"x": 1, "y": 2}, {"x": 1, "z": None}) == [("y", 2, None, False)]
    assert changes({"x": 1}, {"x": 1, "y": 2}, "a:y=ignore") == [("y", None, 2, True)]


def test_arrays_of_other_lengths():
    assert changes({"r": [1, 2]}, {"r": [1, 2, 3]}) == [("len(r)", 2, 3, False), ("r[2]", None, 3, False)]
    assert changes({"r": [1, 2]}, {"r": [1, 2, 3]}, "a:len(r)=1") == [("len(r)", 2, 3, True), ("r[2]", None, 3, True)]
    assert changes({"r": [1, 2]}, {"r": [1, 2.5, 3, 4]}, "a:len(r)=1", "a:r[*]=1")[0] == ("len(r)", 2, 4, False)


def test_elements_go_by_one_name():
    shape = Shapes(rules()).read(said({"poses": [{"x": 1}, {"x": 2}]})[0], REGISTRY).shape
    assert shape.names == ("len(poses)", "poses[*].x", "poses[*].x")


def test_payloads_that_do_not_decode_are_compared_as_bytes():
    a, b = (Message(0, "a", payload) for payload in (b"\x01\x02", b"\x01\x03"))
    assert changes(a, b) == [(PAYLOAD, b"\x01\x02", b"\x01\x03", False)]
    assert changes(a, b, "a:(payload)=ignore") == [(PAYLOAD, b"\x01\x02", b"\x01\x03", True)]
    broken = Message(0, "a", b'{"x": ', encoding="application/json")
    reading = Shapes(rules()).read(broken, REGISTRY)
    assert reading.opaque.startswith("not JSON")
    assert (PAYLOAD, broken.payload, None, False) in changes(broken, {"x": 1})


def test_deletes_and_attachments_are_content():
    put, delete = Message(0, "a", b""), Message(0, "a", b"", "delete")
    assert changes(put, delete) == [(KIND, None, "delete", False)]
    tagged = put.with_(attachment=b"t")
    assert changes(put, tagged) == [(ATTACHMENT, None, b"t", False)]
    assert Shapes(rules(), attachments=False).read(tagged, REGISTRY).values == (b"",)


def test_ros_messages_by_their_fields():
    a, b = (Message(0, "twist", b"\0\1\0\0" + struct.pack("<6d", 1, 2, 3, 4, 5, last)) for last in (6, 6.5))
    assert changes(a, b) == [("angular.z", 6.0, 6.5, False)]
    assert changes(a, b, "twist:angular.*=10%") == [("angular.z", 6.0, 6.5, True)]


def array(*data: int) -> Message:
    return Message(0, "bytes", b"\0\1\0\0" + struct.pack("<III", 0, 0, len(data)) + bytes(data))


def test_elements_that_are_not_listed_are_compared_as_bytes():
    long = [1] * (MOST_ELEMENTS + 10)
    other, early = [*long], [*long]
    other[-1], early[3] = 2, 9
    assert changes(array(*long), array(*long)) == []
    assert changes(array(*long), array(*early)) == [("data[3]", 1, 9, False)]
    assert changes(array(*long), array(*early), "bytes:data[3]=ignore") == [("data[3]", 1, 9, True)]
    beyond = f"data[{MOST_ELEMENTS}]"
    assert changes(array(*long), array(*other)) == [(beyond, "(some bytes)", "(other bytes)", False)]
    assert changes(array(*long), array(*other), "bytes:data[*]=5")[-1][-1] is False
    assert changes(array(*long), array(*other), "bytes:data[*]=ignore")[-1][-1] is True
    assert beyond in [path for path, *_ in changes(array(*long), array(*long, 1))]


def test_equal_contents_have_equal_hashes():
    shapes = Shapes(rules("a:y=ignore"))
    rows = [{"x": -1, "y": 1}, {"x": -1, "y": 2}, {"x": -2, "y": 1}, {"x": True}, {"x": 1}, {"x": "1"}, {"x": math.nan}]
    hashes = [shapes.read(message, REGISTRY).content() for message in said(*rows)]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == len(rows) - 1
    assert hashes[-1] == shapes.read(said({"x": math.nan})[0], REGISTRY).content()


def test_stamps_tell_messages_apart_else_numbers():
    shapes = Shapes(rules())
    names = [
        shapes.read(message, REGISTRY).identity()
        for message in said({"stamp": 4, "seq": 1}, {"seq": 1, "x": 3}, {"x": 3})
    ]
    assert names == [(4,), (1,), None]


def test_hostile_messages_do_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(fields, "_MOST_PATHS", 100)
    shapes = Shapes(rules())
    for message in said(*({f"k{number}": 1} for number in range(1000))):
        shapes.read(message, REGISTRY)
    assert len(shapes._known) <= 100


def test_texts_that_are_no_unicode():
    payload = json.dumps({"x": "\ud800"}).encode()
    assert changes(Message(0, "a", payload, encoding="application/json"), {"x": "a"}) == [("x", "\ud800", "a", False)]
    assert Shapes(rules()).read(Message(0, "a", payload, encoding="application/json"), REGISTRY).content()
