from __future__ import annotations

import sqlite3

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.entry import LogEntry, TopicEntry
from riot_bus_fleet.logs.query import parse_query

NOW = 1_700_100_000.0
SECOND = 10**9


def entry(
    place: str, robot: str = "r1", *topics: str, start: int = 0, seconds: float = 1.0, **more: object
) -> LogEntry:
    begin = 1_700_000_000 * SECOND + start * SECOND
    return LogEntry(
        place=place,
        size=1,
        stamp="1",
        robot=robot,
        start=begin,
        end=begin + int(seconds * SECOND),
        messages=5 * len(topics),
        topics=tuple(
            TopicEntry(each, each.strip("/"), f"pkg/msg/{each.strip('/').title()}", "cdr", 5) for each in topics
        ),
        **more,  # type: ignore[arg-type]
    )


@pytest.fixture
def catalogue() -> Catalogue:
    known = Catalogue(None)
    known.put(entry("/a/1.mcap", "r1", "/odom", "/scan", start=0, seconds=10))
    known.put(entry("/a/2.mcap", "r2", "/odom", start=100, seconds=100))
    known.put(entry("/b/3.mcap", "r10", "/map", start=86_400, seconds=1000, problem="1 damaged chunks"))
    known.put(entry("/b/4.mcap", "r10", readable=False, problem="not an MCAP file"))
    known.put(entry('/b/it\'s "5".mcap', "r o'b", "/odom", start=200, lost=3))
    return known


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "14253"),
        ("robot=r1", "1"),
        ("robot=r1*", "143"),
        ("robot=r1 robot=r2", "12"),
        ("topic=/odom", "125"),
        ("topic=odom", "125"),
        ("topic=/odom topic=/scan", "1"),
        ("type=pkg/msg/Map", "3"),
        ("type='pkg/msg/[MS]*'", "13"),
        ("path=/b/*", "453"),
        ("path='*/it?s \"5\".mcap'", "5"),
        ('robot="r o\'b"', "5"),
        ("after=2023-11-15T00:00:00", "3"),
        ("before=2023-11-15", "1425"),
        ("after=1700000150 before=1700000201", "25"),
        ("after=5h", "3"),
        ("min-duration=100", "23"),
        ("min-duration=100s max-duration=2m", "2"),
        ("min-duration=0.25h", "3"),
        ("min-messages=6", "1"),
        ("lossless", "12"),
        ("damaged", "453"),
        ("damaged topic=/map", "3"),
        ("gone", ""),
        ("robot=nobody", ""),
        ("robot='; DROP TABLE logs; --'", ""),
    ],
)
def test_queries(catalogue: Catalogue, text: str, found: str) -> None:
    query = parse_query(text, now=NOW)
    places = [each.place for each in catalogue.find(query)]
    digits = [next(letter for letter in place if letter.isdigit()) for place in places]
    assert sorted(digits) == sorted(found)
    assert catalogue.count(query) == len(places)


def test_words_of_a_shell_mean_the_same() -> None:
    assert parse_query(["robot=r1", "lossless"], now=NOW) == parse_query("robot=r1 lossless", now=NOW)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("robt=r1", "'robt=r1' is not a condition", "did you mean 'robot'?"),
        ("lossles", "'lossles' is not a condition", "did you mean 'lossless'?"),
        ("lossless=1", "'lossless' takes no value", "write lossless"),
        ("robot=", "'robot' needs a value", "robot=..."),
        ("after", "'after' needs a value", "after=..."),
        ("after=yesterday", "'yesterday' is not a time", "2026-11-21"),
        ("min-duration=5y", "'5y' is not a duration", "write seconds"),
        ("min-messages=-1", "'-1' is not a number", ""),
        ("min-messages=²", "'²' is not a number", ""),
        ("robot='r1", "No closing quotation", "close each quote"),
        ("robot=r1\\", "No escaped character", "no backslash at the end"),
        ("robot=\x1b[31m", "this text cannot be looked for", ""),
        (" ".join(["lossless"] * 101), "101 words are too many", ""),
    ],
)
def test_what_is_no_query(text: str, message: str, hint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_query(text, now=NOW)
    assert message in caught.value.message
    assert hint in (caught.value.hint or "")


@given(st.text() | st.lists(st.sampled_from(["robot=", "topic=*", "after=9d", "'", "=", "lossless", "1"])).map("".join))
def test_any_text_is_a_query_or_refused(text: str) -> None:
    try:
        query = parse_query(text, now=NOW)
    except ConfigError:
        return
    with Catalogue(None) as empty:
        assert empty.find(query) == []


@given(st.text(alphabet=st.characters(exclude_categories=["Cs", "Cc", "Zs", "Zl", "Zp", "Cn", "Co", "Cf"]), min_size=1))
def test_a_text_never_becomes_a_part_of_the_statement(text: str) -> None:
    value = "'" + text.replace("'", "'\"'\"'") + "'"
    query = parse_query(f"robot={value}", now=NOW)
    assert query.parameters == (text,)
    assert query.condition == "(robot GLOB ?) AND NOT gone"
    with sqlite3.connect(":memory:") as db:
        assert db.execute("SELECT ?", query.parameters).fetchone() == (text,)
