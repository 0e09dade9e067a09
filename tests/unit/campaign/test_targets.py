from __future__ import annotations

import json

from riot_bus.campaign.targets import may_change, samples_by_topic, spread, targets_of
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
    messages = [message("t", b'{"a": %d}' % number) for number in range(100)]
    messages.insert(0, message("t", b"", kind="delete"))
    ((topic, (count, samples)),) = samples_by_topic(messages, TypeRegistry()).items()
    assert (topic, count) == ("t", 100)
    assert 1 < len(samples) <= 6
    assert samples[0][1] == b'{"a": 0}'


def test_leaving_alone_goes_before_asking_for() -> None:
    assert may_change("t", "speed", (), ())
    assert not may_change("t", "speed", (), (), asked=True)
    assert may_change("t", "speed", (), ("t:sp*",), asked=True)
    assert not may_change("t", "speed", ("t:*",), ("t:speed",))
    assert not may_change("t", "header.seq", (), ())
    assert not may_change("t", "len(data)", ("t:data",), ())
