import contextlib
import json
import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.types import elements
from riot_bus.types.json_type import JsonType
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_logtools.editing.assignment import parse_assignment
from tests.unit.riot_bus_logtools.editing.edit_tools import NUMBER, cdr

JSON = JsonType()


def applied(text, document):
    return json.loads(parse_assignment(text, "--set").applied(JSON, json.dumps(document).encode()))


@pytest.mark.parametrize(
    ("text", "topic", "field", "operator", "value"),
    [
        ("/odom:x=1", "/odom", "x", "=", 1),
        ("/odom:pose.x = nan", "/odom", "pose.x", "=", "nan"),
        ("/odom:x += 0.5", "/odom", "x", "+=", 0.5),
        ("/odom:x-=1e3", "/odom", "x", "-=", 1000.0),
        ("/scan:ranges[*]*=2", "/scan", "ranges[*]", "*=", 2),
        ("/scan:ranges[3] /= 4", "/scan", "ranges[3]", "/=", 4),
        ("a/b:flags = 0xff", "a/b", "flags", "=", 255),
        ("a:on = true", "a", "on", "=", True),
        ('a:name = "x where y = 1"', "a", "name", "=", "x where y = 1"),
        ("a:name = 'during 3..4'", "a", "name", "=", "during 3..4"),
        ("a:name = plain text", "a", "name", "=", "plain text"),
        ("0/o/n::msg::dds_::O_/H:x=-1", "0/o/n::msg::dds_::O_/H", "x", "=", -1),
        ("a=b:x = 1", "a=b", "x", "=", 1),
    ],
)
def test_spelling(text, topic, field, operator, value):
    found = parse_assignment(text, "--set")
    assert (found.selection.topic, found.field, found.operator) == (topic, field, operator)
    assert found.value == value or (value == "nan" and math.isnan(found.value))
    assert found.selection.whole


def test_conditions_may_follow():
    found = parse_assignment("/odom:x = nan during 5..9 every 2 where y == 1 and z != 'a'", "--set")
    assert found.selection.during == ("5", "9")
    assert found.selection.at_any_time.every == 2
    assert found.selection.at_any_time.where is not None
    assert found.selection.at_any_time.where.fields == ("y", "z")


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("a:v = 3", 1, 3),
        ("a:v = 3", 1.5, 3.0),
        ("a:v = 2.0", 1, 2),
        ("a:v = 7", "text", "7"),
        ("a:v = true", "text", "true"),
        ("a:v = 1", True, True),
        ("a:v += 2", 1, 3),
        ("a:v -= 0.5", 1.0, 0.5),
        ("a:v *= 1.6", 10, 16),
        ("a:v /= 4", 10, 2),
        ("a:v *= -1", 1.5, -1.5),
        ("a:v += 1", 2**63 - 1, -(2**63)),
    ],
)
def test_values_keep_the_kind_of_the_field(text, before, after):
    found = applied(text, {"v": before})["v"]
    assert found == after
    assert type(found) is type(after)


def test_all_elements():
    assert applied("a:v[*].x *= 10", {"v": [{"x": 1}, {"x": 2}], "w": [1]}) == {"v": [{"x": 10}, {"x": 20}], "w": [1]}
    assert applied("a:v[*] = 0", {"v": []}) == {"v": []}


def test_more_elements_than_memory_should_hold_are_refused(monkeypatch):
    monkeypatch.setattr(elements, "_ALL_ELEMENTS", 3)
    assert applied("a:v[*] = 0", {"v": [1, 2, 3]}) == {"v": [0, 0, 0]}
    with pytest.raises(PayloadError, match="4 elements are more than the 3"):
        applied("a:v[*] = 0", {"v": [1, 2, 3, 4]})


@pytest.mark.parametrize("text", ["a:u = 1", "a:v += 1", "a:v.x = 1", "a:u[*] = 1"])
def test_what_cannot_be_done_with_a_payload(text):
    with pytest.raises(PayloadError):
        applied(text, {"v": "text"})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("/odom", "does not say what to set"),
        ("/odom:x", "does not say what to set"),
        ("/odom:x =", "does not say what to set"),
        ("/odom:x == 3", "does not say what to set"),
        ("odom = 3", "does not say what to set"),
        ("/odom:x += text", "not a number to calculate with"),
        ("/odom:x += inf", "not a number to calculate with"),
        ("/odom:x += true", "not a number to calculate with"),
        ("/odom:x /= 0", "divides by zero"),
        ("/odom:len(x) = 3", "length cannot be changed"),
        ("/odom:a..b = 3", "not a field path"),
        ('/odom:x = "\\x"', "not a quoted text"),
        ("/odom:x = 3 during 5", "not a span of time"),
    ],
)
def test_mistakes_are_explained(text, problem):
    with pytest.raises(ConfigError, match=problem):
        parse_assignment(text, "--set")


class TestCdr:
    @pytest.fixture
    def kind(self):
        pytest.importorskip("rosbags")
        from riot_bus.types.model import Schema
        from riot_bus_ros2.adapter import Ros2Adapter

        return Ros2Adapter().type_of_schema(Schema("test_msgs/msg/Number", "ros2msg", NUMBER.encode()))

    def test_only_the_bytes_of_the_field_change(self, kind):
        before = bytearray(cdr(1.5))
        before[13:16] = b"xyz"  # padding, of which some writers leave garbage
        after = parse_assignment("/n:x *= 2", "--set").applied(kind, bytes(before))
        assert after == bytes(before[:4]) + struct.pack("<d", 3.0) + bytes(before[12:])

    def test_integers_wrap_and_floats_overflow(self, kind):
        assert kind.read(parse_assignment("/n:small += 300", "--set").applied(kind, cdr(1.5)), "small") == 45
        assert kind.read(parse_assignment("/n:small -= 2", "--set").applied(kind, cdr(1.5)), "small") == 255
        changed = parse_assignment("/n:values[*] *= 1e39", "--set").applied(kind, cdr(1.5))
        assert [kind.read(changed, f"values[{n}]") for n in range(2)] == [math.inf, math.inf]
        assert kind.read(parse_assignment("/n:x *= 1e308", "--set").applied(kind, cdr(1e10)), "x") == math.inf

    def test_the_shortcut_does_the_same(self, kind):
        for text in ("/n:x = nan", "/n:x = -inf", "/n:small = 300"):
            assignment = parse_assignment(text, "--set")
            shortcut = assignment.shortcut(kind, cdr(2.5))
            if shortcut is not None:
                assert shortcut(cdr(3.5)) == assignment.applied(kind, cdr(3.5))
        assert parse_assignment("/n:x = 1", "--set").shortcut(kind, cdr(2.5)) is not None
        assert parse_assignment("/n:name = x", "--set").shortcut(kind, cdr(2.5)) is None
        assert parse_assignment("/n:x += 1", "--set").shortcut(kind, cdr(2.5)) is None


@settings(deadline=None)
@given(st.text(max_size=40))
def test_any_text_is_understood_or_refused(text):
    with contextlib.suppress(ConfigError):
        assert parse_assignment(text, "--set").text == text
