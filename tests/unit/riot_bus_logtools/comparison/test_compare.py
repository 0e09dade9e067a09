from __future__ import annotations

from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes, compare
from riot_bus_logtools.comparison.recording import Recording
from tests.unit.riot_bus_logtools.comparison.recordings import BEGIN, MS, recording, said, told


def by_time(*parts):
    return sorted((message for part in parts for message in part), key=lambda each: each.time)


def test_topics_that_differ_come_first():
    a = by_time(*(said(b"1", b"2", key=key) for key in "abc"))
    b = by_time(said(b"1", b"2", key="a"), said(b"1", b"3", key="b"), said(b"1", b"2", key="c"))
    found = told(a, b)
    assert [(each.topic, each.same) for each in found.topics] == [("b", False), ("a", True), ("c", True)]
    assert (found.same, found.compared, found.a.messages) == (False, 6, 6)


def test_a_topic_of_one_log_alone_differs():
    found = told(by_time(said(b"1"), said(b"2", b"3", key="b")), by_time(said(b"1"), said(b"4", key="c")))
    assert {each.topic: (each.lost, each.added) for each in found.topics} == {"a": (0, 0), "b": (2, 0), "c": (0, 1)}
    assert not found.same
    assert told(said(b"1"), by_time(said(b"1"), said(b"4", key="c")), "c=1").same


def test_topics_of_the_same_name_belong_together_whatever_their_keys():
    def named(key, topic):
        message = Message(BEGIN, key, b"x")
        return Recording("log", TypeRegistry(), lambda keys: iter([message]), names={key: (topic, "T")})

    found = compare(named("0/odom/T/H1", "/odom"), named("/odom", "/odom"))
    assert (found.same, [each.topic for each in found.topics]) == (True, ["/odom"])
    found = compare(named("0/odom/T/H1", "/odom"), named("0/map/T/H1", "/map"))
    assert [(each.topic, each.count_a, each.count_b) for each in found.topics] == [("/map", 0, 1), ("/odom", 1, 0)]
    assert not found.comparable


def test_topics_that_are_ignored():
    found = told(by_time(said(b"1"), said(b"2", key="b")), said(b"1"), "b=ignore")
    assert (found.same, found.ignored, found.a.messages) == (True, ("b",), 1)


def test_tolerances_that_name_no_topic_are_told():
    found = told(said(b"1"), said(b"1"), "aa:x=1", "a:y=1", "**:z=1")
    assert found.notes == ("the tolerance 'aa:x' names no topic of these logs",)


def test_the_order_across_topics_is_a_question_of_its_own():
    ticks = [Message(BEGIN + n * MS, "ab"[n % 2], b"%d" % n) for n in range(10)]
    other = [message.with_(time=message.time + (MS * 3 // 2 if n == 4 else 0)) for n, message in enumerate(ticks)]
    other.sort(key=lambda each: each.time)
    found = told(ticks, other)
    assert (found.same, found.order.total, found.order.moved) == (True, 10, 1)
    assert not told(ticks, other, order=True).same
    assert told(ticks, ticks, order=True).same


def test_nothing_in_common_is_not_the_same():
    assert not told([], []).same
    assert not told(said(b"1"), []).same
    assert told([], []).topics == ()


def test_without_wishes_everything_counts_but_times():
    assert compare(recording(said({"x": 1, "stamp": 1})), recording(said({"x": 1, "stamp": 2}))).same
    assert not compare(recording(said({"x": 1})), recording(said({"x": 2})), Wishes()).same
