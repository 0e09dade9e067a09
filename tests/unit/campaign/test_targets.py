from __future__ import annotations

import json
from typing import Any

from riot_bus.campaign.targets import may_change, samples_by_topic, spread, targets_of, with_observed
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_ros2.adapter import Ros2Adapter


def message(topic: str, payload: bytes, **more: str) -> Message:
    return Message(10**9, topic, payload, **more)  # type: ignore[arg-type]


def test_fields_of_all_samples_are_targets_and_lengths_are_not() -> None:
    first, second = json.dumps({"a": 1, "list": [1, 2]}), json.dumps({"b": 1.5, "list": []})
    messages = [message("t", first.encode()), message("t", second.encode())]
    (found,) = targets_of(messages, TypeRegistry()).values()
    assert {target.path for target in found} == {"a", "b", "list[0]", "list[1]"}
    assert {target.messages for target in found} == {2}


def test_elements_go_from_the_first_to_the_last_less_what_is_left_alone() -> None:
    payload = json.dumps({"ranges": [1.0] * 500, "rows": [[0] * 6] * 4, "a": 1, "odd[3]": 2}).encode()
    (found,) = targets_of([message("t", payload)], TypeRegistry(), leave=["t:rows?3??5?"]).values()
    elements = {target.path: target.elements for target in found}
    assert elements["a"] == elements['["odd[3]"]'] == ()
    assert elements["ranges[0]"] == elements["ranges[3]"]
    assert (len(elements["ranges[0]"]), elements["ranges[0]"][0]) == (64, "ranges[0]")
    assert elements["ranges[0]"][-1] == "ranges[499]"
    assert len(elements["rows[0][0]"]) == 23
    assert "rows[3][4]" in elements["rows[0][0]"]


def test_indices_are_spread_evenly() -> None:
    assert [spread(length, 4) for length in (0, 1, 4, 7, 100)] == [[], [0], [0, 1, 2, 3], [0, 2, 4, 6], [0, 33, 66, 99]]


def test_what_cannot_be_read_has_no_targets() -> None:
    registry = TypeRegistry([Ros2Adapter()], declared={"/plan": "nav_msgs/msg/Path"})
    messages = [
        message("/plan", b"\0\1\0\0\1"),  # cut off
        message("bytes", b"\xff\xfe\0"),  # nothing tells the type
        message("gone", b"", kind="delete"),
        message("brittle", b'{"seq": 1}'),
    ]
    assert targets_of(messages, registry) == {}


def test_deletes_are_no_samples_and_long_topics_have_a_few() -> None:
    messages = [message("t", b'{"a": %d}' % number) for number in range(1000)]
    messages.insert(0, message("t", b"", kind="delete"))
    ((topic, (count, samples)),) = samples_by_topic(messages, TypeRegistry()).items()
    assert (topic, count) == ("t", 1000)
    assert 100 < len(samples) <= 201
    assert samples[0][1] == b'{"a": 0}'


def test_leaving_alone_goes_before_asking_for() -> None:
    assert may_change("t", "speed", (), ())
    assert not may_change("t", "speed", (), (), asked=True)
    assert may_change("t", "speed", (), ("t:sp*",), asked=True)
    assert not may_change("t", "speed", ("t:*",), ("t:speed",))
    assert not may_change("t", "header.seq", (), ())
    assert not may_change("t", "len(data)", ("t:data",), ())


def values(*documents: dict[str, Any]) -> dict[str, set[Any]]:
    messages = [Message(10**9 + n, "a", json.dumps(each).encode()) for n, each in enumerate(documents)]
    targets = with_observed(targets_of(messages, TypeRegistry()), messages, TypeRegistry())
    return {each.path: {told.value for told in each.told} for each in targets.get("a", ())}


def test_limits_and_one_beyond() -> None:
    found = values({"i": 3}, {"i": 7}, {"i": 5})
    assert found == {"i": {2, 3, 5, 7, 8}}
    assert values({"i": 3}, {"i": 3}) == {"i": {2, 4}}
    assert values({"x": 0.5, "b": True}, {"x": -0.5, "b": False}) == {"x": {-1.5, -0.5, 0.5, 1.5}, "b": set()}


def test_some_numbers_of_other_messages() -> None:
    assert values(*({"i": i} for i in (4, 0, 9, 8, 4, 6, 5)))["i"] == {-1, 0, 9, 10, 4, 6, 5}
    many = [0, 1000, *range(1, 150)]
    assert values(*({"i": i} for i in many))["i"] == {-1, 0, 1000, 1001, 1, 75, 149}


def test_texts_of_other_messages_and_of_other_fields() -> None:
    found = values({"mode": "auto", "state": "idle"}, {"mode": "dock", "state": "idle"})
    assert found == {"mode": {"auto", "dock", "idle"}, "state": {"auto", "dock"}}


def test_numbers_of_other_fields_are_those_of_the_same_type() -> None:
    assert values({"i": 3, "k": 40, "x": 0.5, "long": "A" * 5000, "s": "b"}) == {
        "i": {2, 4, 40},
        "k": {39, 41, 3},
        "x": {-0.5, 1.5},
        "long": {"b"},
        "s": set(),
    }


def test_what_is_no_number_is_no_limit() -> None:
    assert values({"x": float("nan")}, {"x": float("inf")}, {"x": 2.0}) == {"x": {1.0, 3.0}}
