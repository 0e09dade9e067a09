"""What an interceptor sees of a message that is not yet taken apart, and what it must not make of it."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from riot_bus.pipeline.event import Event, check
from riot_bus.types.json_type import JsonType
from riot_bus.vocabulary.elements import Elements
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message, Qos

MESSAGE = Message(5, "a/b", b'{"x": 1}')


class Arrival:
    """A message that counts how often it is taken apart."""

    key, time, segment = MESSAGE.key, MESSAGE.time, "one"

    def __init__(self) -> None:
        self.taken_apart = 0

    def payload(self) -> bytes:
        return MESSAGE.payload

    def message(self) -> Message:
        self.taken_apart += 1
        return MESSAGE


def arrived() -> tuple[Event, Arrival]:
    arrival = Arrival()
    return Event(None, "a/b", 0, 0.0, arrival, kind=JsonType()), arrival


def event() -> Event:
    return Event(MESSAGE, "a/b", 0, 0.0, kind=JsonType())


def test_reading_a_field_takes_nothing_apart_but_the_payload() -> None:
    seen, arrival = arrived()
    assert (seen.key, seen.payload, seen.read("x")) == ("a/b", b'{"x": 1}', 1)
    assert seen.new_payload is None
    assert arrival.taken_apart == 0


def test_a_changed_payload_is_known_without_the_message() -> None:
    seen, arrival = arrived()
    seen.set("x", 2)
    assert seen.new_payload == seen.payload == b'{"x": 2}'
    assert arrival.taken_apart == 0
    assert seen.message.payload == b'{"x": 2}'
    assert seen.original is MESSAGE
    assert arrival.taken_apart == 1
    seen.replace(b"3")
    assert seen.message.payload == b"3"
    assert seen.new_payload is None, "the message is there, so more than its payload may be different"


def test_the_digest_is_that_of_the_message_as_it_came() -> None:
    seen, _ = arrived()
    seen.set("x", 2)
    assert seen.digest == MESSAGE.digest()


def test_elements_are_read_and_set_at_once() -> None:
    payload = b'{"poses": [{"x": 1}, {"x": 2.5}], "n": 7}'
    seen = Event(Message(0, "k", payload), "k", 0, 0.0, kind=JsonType())
    assert seen.read_elements("poses[*].x") == (1, 2.5)
    seen.set_elements("poses[*].x", Elements([1, 2.5]))
    assert (seen.touched, seen.payload) == (False, payload)
    seen.set_elements("poses[*].x", Elements([1, 3.5]))
    assert json.loads(seen.payload) == {"poses": [{"x": 1}, {"x": 3.5}], "n": 7}
    assert [(change.action, change.field) for change in seen.changes] == [("set", "poses[*].x")]
    with pytest.raises(PayloadError, match="2 elements are not set to 1"):
        seen.set_elements("poses[*].x", Elements([1]))


def test_without_provenance_the_values_are_not_noted() -> None:
    seen = Event(MESSAGE, "a/b", 0, 0.0, kind=JsonType(), provenance=False)
    seen.set("x", 2)
    assert [(each.action, each.field, each.after) for each in seen.changes] == [("set", "x", None)]


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"key": "a//b"}, ValueError),
        ({"key": "a/*"}, ValueError),
        ({"payload": "text"}, TypeError),
        ({"attachment": "text"}, TypeError),
        ({"encoding": 7}, TypeError),
        ({"encoding": "\ud800"}, TypeError),
        ({"time": 1.5}, TypeError),
        ({"qos": None}, ValueError),
        ({"qos": Qos(priority=0)}, ValueError),
        ({"kind": "post"}, ValueError),
    ],
)
def test_a_message_that_cannot_be_published_is_refused(changes, error) -> None:
    wrong = replace(MESSAGE, **changes)
    with pytest.raises(error):
        event().message = wrong
    with pytest.raises(error):
        event().add(wrong)


def test_what_is_no_message_is_refused() -> None:
    with pytest.raises(TypeError, match="is not a message"):
        event().message = b"payload"
    with pytest.raises(TypeError, match="is not a payload"):
        event().replace("text")
    with pytest.raises(TypeError, match="number of copies"):
        event().duplicate(1.5)


def test_added_messages_are_bounded() -> None:
    seen = event()
    for _ in range(10_000):
        seen.add(MESSAGE)
    with pytest.raises(ValueError, match="too many"):
        seen.add(MESSAGE)


@pytest.mark.parametrize(
    ("attributes", "error"),
    [
        ({"delay_ns": 1.5}, TypeError),
        ({"copies": "2"}, TypeError),
        ({"copies": 10_001}, ValueError),
        ({"added": "x"}, TypeError),
        ({"changes": {}}, TypeError),
        ({"added": [(MESSAGE, 1.5)]}, TypeError),
        ({"added": [(b"payload", 1)]}, TypeError),
    ],
)
def test_attributes_that_were_set_to_something_else_are_found(attributes, error) -> None:
    seen = event()
    check(seen)
    for name, value in attributes.items():
        setattr(seen, name, value)
    with pytest.raises(error):
        check(seen)
