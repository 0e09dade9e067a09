from __future__ import annotations

from riot_bus.log.showing import value_text
from riot_bus_logtools.comparison.text import MOST_FIELDS, facts, moves, rest_lines, spans, topic_lines
from tests.unit.riot_bus_logtools.comparison.recordings import of_topic, said, told

ROWS = [{"n": number, "x": number * 0.5} for number in range(50)]


def test_numbers_that_follow_one_another_stand_together():
    assert spans((3, 7, 8, 9, 20), 5) == "#3, #7-9, #20"
    assert spans(tuple(range(0, 40, 2)), 30) == "#0, #2, #4, #6, #8, #10, #12, #14 and 22 more"


def test_values_are_short():
    assert value_text(None) == "(none)"
    assert value_text("a\nb") == '"a\\nb"'
    assert value_text(b"\x01\xff") == "01ff"
    assert len(value_text("x" * 500)) == 80


def test_a_topic_that_differs():
    rows = [{**row, "x": row["x"] + 1} if number in (5, 6) else row for number, row in enumerate(ROWS)]
    found = of_topic(ROWS, [*rows[:20], *rows[21:40], rows[41], rows[40], *rows[42:]])
    lines = [*topic_lines(found)]
    assert lines[0] == "! a  46 of 50 -> 49 equal, 2 changed, 1 lost, 1 out of order"
    assert lines[1] == "    x  in 2 messages, by 1 at most (median 1): #5 (0.005 s) 2.5 -> 3.5"
    assert lines[2] == "    lost #20"
    assert lines[3].startswith("    out of order #4")
    assert facts(found) == [("changed", "2"), ("lost", "1"), ("out of order", "1")]


def test_a_topic_that_does_not():
    assert [*topic_lines(of_topic(ROWS, ROWS))] == ["= a  50 of 50 equal"]
    assert [*topic_lines(of_topic(ROWS, ROWS[1:], "a=3"))] == [
        "= a  49 of 50 -> 49 equal, 1 lost",
        "    lost #0",
        "    3 may be lost, added or out of order",
    ]


def test_what_there_is_too_much_of_is_counted():
    rows = [{f"f{number:02d}": value for number in range(25)} for value in (1, 2)]
    lines = [*topic_lines(of_topic(rows[:1], rows[1:]))]
    assert len(lines) == MOST_FIELDS + 2
    assert lines[-1] == "    ... 15 further fields"
    swapped = [*ROWS]
    for place in range(0, 40, 2):
        swapped[place : place + 2] = reversed(swapped[place : place + 2])
    assert moves(of_topic(ROWS, swapped)).endswith(" and 12 more")


def test_what_is_said_of_all_topics():
    stamped = [[{**row, "stamp": begin} for row in ROWS] for begin in (1, 2)]
    found = told(said(*stamped[0]), said(*stamped[1], period=2 * 10**6))
    assert [*rest_lines(found.topics)] == [
        "not compared, in so many messages different: a:stamp (50)",
        "timing: a differs most, by 0.049 s (median 0.025 s)",
    ]


def test_late_messages_and_bytes_are_told():
    (late,) = told(said(b"1", b"2"), said(b"1", b"3", period=10**9), timing=0.5).topics
    lines = [*topic_lines(late)]
    assert "    1 message compared as bytes: no type is known" in lines
    assert lines[-1] == "    1 message too early or late, #1 by 0.999 s"
