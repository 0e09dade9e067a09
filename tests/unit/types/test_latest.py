"""Fields of the latest messages; rules over whole logs are in tests/unit/chain/unit/test_prediction.py."""

from __future__ import annotations

import json

import pytest

from riot_bus.types.latest import LatestFields, in_words
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def message(topic: str, kind: str = "put", **values: object) -> Message:
    return Message(10**18, topic, json.dumps(values).encode(), encoding="application/json", kind=kind)  # type: ignore[arg-type]


def test_each_field_is_that_of_its_message() -> None:
    latest = LatestFields(["a[0]:x", "a[2]:x", "b:y[1]", "b:y"], ["a", "b", "a", "a"], registry=TypeRegistry())
    assert latest.take(message("c", x=1)) is None
    assert latest.take(message("a", x=1)) == {"a[2]:x": 1}
    assert latest.take(message("b", y=[5, 6])) == {"a[2]:x": 1, "b:y[1]": 6}
    latest.take(message("a", x=2))
    assert latest.take(message("a", "delete")) is None
    assert latest.take(message("a", x=3)) == {"a[0]:x": 1, "a[2]:x": 3, "b:y[1]": 6}
    assert latest.take(message("a", x="four")) == {"a[0]:x": 2, "a[2]:x": "four", "b:y[1]": 6}
    assert latest.take(message("a")) == {"a[0]:x": 3, "b:y[1]": 6}


def test_an_order_is_told_at_its_second_message() -> None:
    latest = LatestFields(["a before b", "a before the first b", "a:x"], ["a", "b"], registry=TypeRegistry())
    assert latest.take(message("b")) == {"a before b": False, "a before the first b": False}
    assert latest.take(message("a", x=1)) == {"a:x": 1}
    assert latest.take(message("b")) == {"a before b": True, "a before the first b": False, "a:x": 1}
    assert latest.take(message("b", "delete")) is None
    first = LatestFields(["a before the first b"], [], registry=TypeRegistry())
    assert [first.take(message(topic)) for topic in "abb"] == [
        {},
        {"a before the first b": True},
        {"a before the first b": False},
    ]


def test_a_message_without_a_field_is_as_if_it_had_not_come_if_earlier_values_are_kept() -> None:
    latest = LatestFields(["a[0]:x", "a[1]:x", "a[1]:y"], ["a", "a"], registry=TypeRegistry(), keeps=True)
    latest.take(message("a", x=1))
    assert latest.take(message("a", x=2, y=5)) == {"a[0]:x": 1, "a[1]:x": 2, "a[1]:y": 5}
    assert latest.take(message("a", y=6)) == {"a[0]:x": 1, "a[1]:x": 2, "a[1]:y": 6}
    assert latest.take(message("a", x=None)) == {"a[0]:x": 1, "a[1]:x": 2, "a[1]:y": 6}
    assert latest.take(message("a", x=3)) == {"a[0]:x": 2, "a[1]:x": 3, "a[1]:y": 6}


def test_quantities_of_elements_are_read() -> None:
    latest = LatestFields(["a[0]:max(r[*])", "a[1]:isnan(r[*])"], ["a", "a"], registry=TypeRegistry())
    latest.take(message("a", r=[1, 7]))
    assert latest.take(message("a", r=[float("nan"), 0.0])) == {"a[0]:max(r[*])": 7, "a[1]:isnan(r[*])": True}


def test_names_in_words() -> None:
    topics = ["a", "a", "b", "a"]
    told = {name: in_words(name, topics) for name in ("a[2]:x", "a[1]:x", "a[0]:x", "b:len(y)", "a before b")}
    assert list(told.values()) == ["a:x", "previous a:x", "2 before the latest a:x", "b:len(y)", "a before b"]
    assert in_words("plain", topics) == "plain"


@pytest.mark.parametrize("name", ["x", "", ":x", "a[1]:x"])
def test_what_is_no_field_is_an_error(name: str) -> None:
    with pytest.raises(ConfigError, match=r"not the name of a field|not there"):
        LatestFields([name], ["a"], registry=TypeRegistry())
