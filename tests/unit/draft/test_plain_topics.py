from __future__ import annotations

import pytest

from riot_bus.draft.plain_topics import grouped, remark, topic_groups, topics_by_name, uses_of
from riot_bus.draft.topic_look import TopicDraft
from riot_bus.graph.model import Edge, Graph, Topic

NAMES = {"11": "sim", "22": "planner", "33": "planner"}
POSE = TopicDraft(
    "r/1/pose", "r/1/pose", "json", encodings=("application/json",), count=10, rate=5.0, sizes=(3, 9), read=10
)
UUIDS = [f"{number:08x}-0000-4000-8000-000000000000" for number in range(2)]


def edges(*rows: tuple[str, str, str]) -> Graph:
    return Graph.of((), (), [Edge(topic, role, "s", zid) for zid, role, topic in rows], ())  # type: ignore[arg-type]


def test_uses_are_those_of_all_sessions_of_a_component() -> None:
    graph = edges(("11", "publishes", "a"), ("22", "subscribes", "a"), ("33", "subscribes", "b"), ("99", "serves", "c"),
                  ("22", "subscribes", "a/*"), ("22", "subscribes", "x/**"), ("22", "subscribes", "x/1"))  # fmt: skip
    assert uses_of(graph, NAMES) == {
        ("sim", "publishes"): {"a"},
        ("planner", "subscribes"): {"a", "b", "a/*", "x/1"},  # of x/** a key is known
    }


def test_keys_that_are_used_alike_and_have_messages_of_one_kind_are_one_topic() -> None:
    keys = [f"r/{number}/pose" for number in (1, 2, 3)]
    graph = edges(*(("11", "publishes", key) for key in keys))
    topics = {key: TopicDraft(key, key, "json", count=2, rate=1.0, sizes=(n, n), read=2) for n, key in enumerate(keys)}
    uses = uses_of(graph, NAMES)
    groups = topic_groups(graph, uses, topics)
    assert groups == {"r/*/pose": keys}
    (one,) = topics_by_name(groups, topics).values()
    assert (one.count, one.rate, one.sizes, one.read) == (6, 3.0, (0, 2), 6)
    reader = edges(*(("11", "publishes", key) for key in keys), ("22", "subscribes", keys[0]))
    assert topic_groups(reader, uses_of(reader, NAMES), topics).keys() == set(keys)
    unknown = edges(*(("11" if key != keys[2] else "", "publishes", key) for key in keys))
    assert topic_groups(unknown, uses_of(unknown, NAMES), topics).keys() == set(keys)
    assert topic_groups(graph, uses, {**topics, keys[1]: TopicDraft(keys[1], keys[1], "cbor")}).keys() == set(keys)
    assert topics_by_name({"a": ["a"]}, {}) == {}


def test_topics_are_called_as_adapters_do_and_services_are_none() -> None:
    row = Edge("0/odom/T/h", "subscribes", "s", "22"), Edge("q", "serves", "s", "22")
    graph = Graph.of((), [Topic("0/odom/T/h", "/odom")], row, ())
    topics = {"0/odom/T/h": TopicDraft("/odom", "0/odom/T/h", "T")}
    assert topic_groups(graph, uses_of(graph, NAMES), topics) == {"/odom": ["0/odom/T/h"]}


def test_remarks() -> None:
    assert remark(POSE, 3) == "json, application/json, 3 to 9 bytes, 5/s, 3 keys"
    assert remark(TopicDraft("k", "k", count=1, sizes=(4, 4))) == "type unknown, 4 bytes, 1 seen"
    assert remark(None) == "no message was seen"


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (["r/1/p", "r/2/p"], {"r/*/p"}),
        (["r/1/p", "r/20/p", "r/1/q", "r/20/q"], {"r/*/p", "r/*/q"}),
        ([f"r/{each}" for each in UUIDS], {"r/*"}),
        (["r/1/p"], {"r/1/p"}),  # one is no group
        (["r/a/p", "r/b/p"], {"r/a/p", "r/b/p"}),  # names are not numbers
        (["r1/p", "r2/p"], {"r1/p", "r2/p"}),  # a number within a chunk is a name
        (["r/1/2", "r/1/3", "r/2/2"], {"r/1/2", "r/1/3", "r/2/2"}),  # by which of two numbers?
        ([f"r/{a}/{b}" for a in (1, 2) for b in (1, 2, 3)], {"r/1/*", "r/2/*"}),
        (["r/1/p", "r/2/p", "r/x/p"], {"r/1/p", "r/2/p", "r/x/p"}),  # the expression would include another key
    ],
)
def test_keys_that_differ_by_a_number_or_id(keys: list[str], expected: set[str]) -> None:
    found = grouped(dict.fromkeys(keys, "json"))
    assert found.keys() == expected
    assert sorted(key for members in found.values() for key in members) == sorted(keys)


def test_what_is_not_alike_stays_apart() -> None:
    assert grouped({"r/1/p": "json", "r/2/p": "raw"}).keys() == {"r/1/p", "r/2/p"}
    assert grouped({"r/1/p": 0, "r/2/p": 0}, ["r/3/p"]).keys() == {"r/1/p", "r/2/p"}
    assert grouped({}) == {}
