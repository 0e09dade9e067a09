from __future__ import annotations

import struct

import pytest

from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison import band
from tests.unit.riot_bus_logtools.comparison.recordings import BEGIN, MS, counts, of_topic, said, told

ROWS = [{"n": number, "x": number * 0.5} for number in range(50)]


def changed(place, **fields):
    return [{**row, **fields} if number == place else row for number, row in enumerate(ROWS)]


def test_equal_topics():
    found = of_topic(ROWS, ROWS)
    assert (counts(found), found.same, found.fields) == ((50, 0, 0, 0, 0), True, ())


def test_one_changed_field():
    found = of_topic(ROWS, changed(17, x=99.5))
    assert (counts(found), found.same) == ((49, 1, 0, 0, 0), False)
    (field,) = found.fields
    example = field.example
    assert (field.name, field.messages, field.largest) == ("x", 1, 91.0)
    assert (example.path, example.a, example.b, example.before, example.after) == ("x", 17, 17, 8.5, 99.5)
    assert example.seconds == pytest.approx(0.017)


def test_one_lost_one_added_and_one_swapped():
    lost = of_topic(ROWS, ROWS[:20] + ROWS[21:])
    assert (counts(lost), lost.lost_at) == ((49, 0, 1, 0, 0), (20,))
    added = of_topic(ROWS, [*ROWS[:20], {"n": -1, "x": 0}, *ROWS[20:]])
    assert (counts(added), added.added_at) == ((50, 0, 0, 1, 0), (20,))
    swapped = of_topic(ROWS, [*ROWS[:20], ROWS[21], ROWS[20], *ROWS[22:]])
    assert counts(swapped) == (49, 0, 0, 0, 1)
    assert swapped.moved_at in (((20, 21),), ((21, 20),))
    assert {lost.same, added.same, swapped.same} == {False}


def test_tolerances():
    found = of_topic(ROWS, changed(17, x=8.6), "a:x=0.2")
    assert (counts(found), found.near, found.same) == ((50, 0, 0, 0, 0), 1, True)
    assert not of_topic(ROWS, changed(17, x=8.9), "a:x=0.2").same
    assert of_topic(ROWS, changed(17, x=8.6), "a:x=2%").same


def test_so_many_messages_may_be_missing():
    found = of_topic(ROWS, ROWS[:20] + ROWS[22:], "a=2")
    assert (found.same, found.allowed, found.lost) == (True, 2.0, 2)
    assert not of_topic(ROWS, ROWS[:20] + ROWS[23:], "a=2").same
    assert of_topic(ROWS, ROWS[:20] + ROWS[22:], "a=4%").same
    assert not of_topic(ROWS, changed(17, x=9), "a=5").same


def test_times_of_messages_are_told_and_do_not_count():
    stamped = [[{**row, "stamp": begin + row["n"]} for row in ROWS] for begin in (0, 1000)]
    found = of_topic(*stamped)
    assert (found.same, found.left) == (True, {"stamp": 50})
    assert not of_topic(*stamped, "a:stamp=5").same


def test_when_messages_come():
    late = [
        message.with_(time=message.time + (40 * MS if place == 30 else 0)) for place, message in enumerate(said(*ROWS))
    ]
    (found,) = told(said(*ROWS), late).topics
    assert found.same
    assert (found.timing.largest, found.timing.median, found.timing.number) == (pytest.approx(0.04), 0.0, 30)
    (found,) = told(said(*ROWS), late, timing=0.05).topics
    assert (found.same, found.timing.late) == (True, 0)
    (found,) = told(said(*ROWS), late, timing=0.03).topics
    assert (found.same, found.timing.late) == (False, 1)


def test_times_are_counted_from_the_first_message_in_common():
    (found,) = told(said(*ROWS), said(*ROWS[1:], begin=BEGIN + 9 * 10**9)).topics
    assert (found.lost_at, found.timing.largest) == ((0,), 0.0)


def test_payloads_without_a_type():
    found = of_topic([b"\x01\x02", b"\x03"], [b"\x01\x02", b"\x04"])
    assert (counts(found), found.opaque) == ((1, 1, 0, 0, 0), {"no type is known": 1})
    assert found.fields[0].example.before == b"\x03"


def test_other_bytes_of_the_same_fields():
    assert not of_topic([b"\x01"], [b"\x01 "]).same
    a, b = (Message(0, "a", payload, encoding="application/json") for payload in (b'{"x": 1}', b'{"x":1}'))
    (found,) = told([a], [b]).topics
    assert (found.same, found.equal, found.same_fields) == (True, 1, 1)


def test_other_encodings_and_types_are_told():
    a = Message(0, "a", b"1", encoding="application/json")
    (found,) = told([a], [a.with_(encoding="text/plain")]).topics
    assert (found.same, found.labels) == (False, {"encoding": ("application/json", "text/plain")})
    (found,) = told([a], [a.with_(encoding="")]).topics
    assert (found.same, found.labels) == (True, {})


def test_what_is_not_aligned_is_never_the_same(monkeypatch):
    monkeypatch.setattr(band, "MOST_CELLS", 10)
    found = of_topic([{"x": f"a{n}"} for n in range(30)], [{"x": f"b{n}"} for n in range(20)], "a=100")
    assert (found.same, found.unaligned, counts(found)) == (False, (30, 20), (0, 0, 0, 0, 0))


def test_where_messages_differ():
    found = of_topic(ROWS, changed(10, x=1))
    assert [place for place, share in enumerate(found.profile) if share] == [10]
    assert of_topic(ROWS, ROWS).profile == ()
    many = [{"x": number} for number in range(1000)]
    assert sum(of_topic(many, [{"x": -1}] * 500 + many[500:]).profile) == pytest.approx(60, abs=1)


def test_ros_messages():
    kind = "geometry_msgs::msg::dds_::Twist_"
    key = f"0/cmd/{kind}/RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"

    def twists(*last):
        return [Message(BEGIN + n, key, b"\0\1\0\0" + struct.pack("<6d", n, 0, 0, 0, 0, z)) for n, z in enumerate(last)]

    (found,) = told(twists(1, 2, 3), twists(1, 2.5, 3)).topics
    assert (found.topic, counts(found)) == ("/cmd", (2, 1, 0, 0, 0))
    assert (found.fields[0].name, found.fields[0].largest) == ("angular.z", 0.5)
    assert told(twists(1, 2, 3), twists(1, 2.5, 3), "/cmd:angular.z=0.5").same


def test_memory_for_messages_that_are_looked_into_is_bounded(monkeypatch):
    from riot_bus_logtools.comparison import compare as topics

    monkeypatch.setattr(topics, "_IN_MEMORY", 10)
    found = of_topic(ROWS, [{**row, "x": row["x"] + 1} for row in ROWS])
    assert counts(found) == (0, 50, 0, 0, 0)
