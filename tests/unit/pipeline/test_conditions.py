import json

import pytest

from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.model import TopicName
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

SECOND = 10**9


class Spy:
    """Notes what it is asked, and changes it."""

    def __init__(self):
        self.asked = []

    def message(self, event):
        self.asked.append(event)
        event.set("n", -1)


class Adapter:
    name = "robot"

    def topic(self, key):
        return TopicName("/" + key.split("/")[1]) if key.startswith("0/") else None

    def key_expression(self, topic):
        return f"0/{topic[1:]}/*" if topic.startswith("/") else None

    def type_named(self, name):
        return None


def asked(when, *messages, targets=(), start=None):
    """Numbers of the messages about which an interceptor is asked; nothing may raise."""
    spy = Spy()
    pipeline = Pipeline([Selective(spy, when)], registry=TypeRegistry([Adapter()]), start=start)
    for message in messages:
        pipeline.feed(message, targets=targets)
    assert pipeline.errors == {}
    return [json.loads(event.original.payload)["n"] for event in spy.asked]


def message(n, key="a", *, seconds=None, segment="", **fields):
    time = SECOND + round((n / 10 if seconds is None else seconds) * SECOND)
    return Message(time, key, json.dumps({"n": n, **fields}).encode(), segment=segment)


def several(number, **more):
    return [message(n, **more) for n in range(number)]


def test_without_conditions_every_message_is_meant():
    assert asked(When(), *several(3), message(3, "b/c"), targets=("x", "y")) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("select", "expected"),
    [
        ("a", [0]),
        ("b/*", [1]),
        ("**", [0, 1, 2, 3]),
        (("a", "b/c"), [0, 1]),
        (("a", "a"), [0]),
        ("/odom", [2]),
        ("0/odom/x", [2]),
        ("/odom where n > 5", []),
        ("** where n >= 2", [2, 3]),
        (("a where n > 5", "a where n == 0"), [0]),
        (("** where n == 3", "a"), [0, 3]),
        ("z", []),
    ],
)
def test_select(select, expected):
    keys = ("a", "b/c", "0/odom/x", "0/scan/x")
    assert asked(When(select), *(message(n, key) for n, key in enumerate(keys))) == expected


def test_a_selector_whose_fields_are_missing_does_not_hide_another():
    when = When(("a where speed > 1", "a where n == 1"))
    assert asked(when, *several(3), message(3, speed=2)) == [1, 3]


def test_predicates_of_one_topic_do_not_concern_another():
    when = When(("a where n > 5", "b"))
    assert asked(when, message(0, "a"), message(1, "b"), message(7, "a")) == [1, 7]


def test_where_and_select_must_both_hold():
    when = When("a where n > 1", where="n < 4 and mode == 'on'")
    modes = ["on", "on", "off", "on", "on"]
    assert asked(when, *(message(n, mode=mode) for n, mode in enumerate(modes))) == [3]


@pytest.mark.parametrize("where", ["speed > 0", "n.x == 1", "n == 'text'", "len(n) > 0", "n[0] == 1"])
def test_a_message_without_the_fields_is_left_alone(where):
    assert asked(When(where=where), *several(3)) == []
    assert asked(When(f"a where {where}"), *several(3)) == []


@pytest.mark.parametrize("payload", [b"", b"\xff\xfe", b"{", b'{"n": ', b"[]", b"\x81\xa1n\xc4\x01x", bytes(100)])
def test_hostile_payloads_are_left_alone(payload):
    spies = [Spy(), Spy()]
    conditions = [When(where="n > 1 or n < 'a'"), When("a where n < 'a'")]
    interceptors = [Selective(spy, when) for spy, when in zip(spies, conditions, strict=True)]
    pipeline = Pipeline(interceptors, registry=TypeRegistry())
    original = Message(0, "a", payload)
    assert pipeline.feed(original).emissions[0].message is original
    assert pipeline.errors == {}
    assert not spies[0].asked + spies[1].asked


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        (When(start=0.3), [3, 4, 5]),
        (When(end=0.3), [0, 1, 2]),
        (When(start=0.1, end=0.4), [1, 2, 3]),
        (When(start=0.55), []),
        (When(end=float("inf")), [0, 1, 2, 3, 4, 5]),
        (When(first=2), [2, 3, 4, 5]),
        (When(last=0), [0]),
        (When(first=2, last=2), [2]),
        (When(first=1, last=4, start=0.2, end=0.4), [2, 3]),
    ],
)
def test_windows_of_time_and_number(when, expected):
    assert asked(when, *several(6)) == expected


def test_time_counts_from_the_first_message_of_all_and_numbers_within_the_topic():
    log = [message(0, "b", seconds=0), message(1, "a", seconds=2), message(2, "a", seconds=3), message(3, "b")]
    assert asked(When("a", start=2, end=3), *log) == [1]
    assert asked(When(first=1), *log) == [2, 3]


def test_a_message_from_before_the_beginning_is_not_in_a_window():
    log = [message(0, seconds=-1), message(1, seconds=1)]
    assert asked(When(start=0.5), *log, start=SECOND) == [1]
    assert asked(When(end=0.5), *log, start=SECOND) == [0]


def test_from_a_segment():
    log = [message(n, segment=segment) for n, segment in enumerate(("outside", "inside", ""))]
    assert asked(When(source="inside"), *log) == [1]


def test_to_a_segment_others_get_it_as_it_was():
    spy, later = Spy(), Spy()
    later.message = later.asked.append
    interceptors = [Selective(spy, When(target="b")), later]
    pipeline = Pipeline(interceptors, registry=TypeRegistry())
    result = pipeline.feed(message(0), targets=("a", "b", "c"))
    assert [(each.targets, each.message.payload) for each in result.emissions] == [
        (("a", "c"), b'{"n": 0}'),
        (("b",), b'{"n": -1}'),
    ]
    assert result.emissions[0].message is result.original
    assert [event.targets for event in spy.asked] == [("b",)]
    assert sorted(event.targets for event in later.asked) == [("a", "c"), ("b",)]
    counts = pipeline.counts["a"]
    assert (counts.seen, counts.copies, counts.changed, counts.delivered) == (1, 1, 1, 2)


def test_a_drop_on_one_way_is_none_on_the_other():
    drop = type("Drop", (), {"message": lambda self, event: event.drop()})()
    pipeline = Pipeline([Selective(drop, When(target="b"))], registry=TypeRegistry())
    result = pipeline.feed(message(0), targets=("a", "b"))
    assert not result.dropped
    assert [each.targets for each in result.emissions] == [("a",)]
    assert pipeline.feed(message(1), targets=("b",)).dropped
    assert pipeline.feed(message(2), targets=("a",)).emissions[0].targets is None


def test_to_means_nothing_where_there_are_no_segments():
    assert asked(When(target="b"), *several(2)) == [0, 1]


@pytest.mark.parametrize("probability", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_probability_is_the_share_of_messages(probability):
    chosen = asked(When(probability=probability), *several(2000))
    assert abs(len(chosen) / 2000 - probability) < (0.05 if 0 < probability < 1 else 1e-9)


def test_the_same_seed_chooses_the_same_messages_whatever_else_comes():
    alone = asked(When("a", probability=0.5, seed=3), *several(100))
    mixed = [each for n in range(100) for each in (message(1000 + n, "b"), message(n))]
    assert alone == asked(When("a", probability=0.5, seed=3), *mixed)
    assert alone != asked(When("a", probability=0.5, seed=4), *several(100))


def test_choice_depends_on_content_and_number_and_name():
    def chosen(name, **fields):
        spy = Spy()
        interceptor = Selective(spy, When(probability=0.5), name)
        pipeline = Pipeline([interceptor], registry=TypeRegistry())
        for each in several(100, **fields):
            pipeline.feed(each)
        return [event.index for event in spy.asked]

    assert chosen("x") == chosen("x") != chosen("y")
    assert chosen("x", other=1) != chosen("x")
    same = [Message(SECOND, "a", b'{"n": 0}')] * 100
    assert 20 < len(asked(When(probability=0.5), *same)) < 80


def test_the_seed_reaches_what_the_interceptor_draws():
    def draws(seed):
        found = []
        spy = type("Spy", (), {"message": lambda self, event: found.append((event.draw(), event.draw("more")))})()
        pipeline = Pipeline([Selective(spy, When(seed=seed))], registry=TypeRegistry())
        pipeline.feed(message(0))
        return found

    assert draws(1) == draws(1) != draws(2)
    assert len(set(draws(1)[0])) == 2


@pytest.mark.parametrize(
    ("options", "problem", "hint"),
    [
        ({"probability": -0.1}, "probability = -0.1 is not between 0 and 1", ""),
        ({"probability": float("nan")}, "probability = nan", ""),
        ({"start": 2, "end": 2}, "end = 2 is not later than start = 2", ""),
        ({"start": float("nan")}, "start = nan", "give seconds"),
        ({"end": float("nan")}, "end = nan", "give seconds"),
        ({"first": 3, "last": 2}, "last = 2 is before first = 3", ""),
        ({"where": ""}, "expected a field path", "mode == 2"),
        ({"where": "speed >"}, "column 8", "mode == 2"),
        ({"select": "/odom where speed >"}, "column 8", "mode == 2"),
        ({"select": ("/odom", "/scan where x ==")}, "expected a number", "mode == 2"),
        ({"select": ""}, "names no topic", "KEYEXPR"),
        ({"select": ()}, "empty list", "name a topic"),
        ({"select": "/odom:pose.x"}, "chooses a field, not messages", "'/odom where pose.x > 0'"),
        ({"select": "/odom:pose x"}, "not a field path", "scan.ranges[3]"),
    ],
)
def test_wrong_conditions_are_refused_before_anything_runs(options, problem, hint):
    with pytest.raises(ConfigError) as caught:
        When(**options)
    assert problem in str(caught.value)
    assert hint in str(caught.value.hint or "")
