"""Fields of the latest messages; rules over whole logs are in tests/unit/chain/test_prediction.py."""

from __future__ import annotations

import json

import pytest

from riot_bus.types.latest import LatestFields
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


@pytest.mark.parametrize("name", ["x", "", ":x", "a[1]:x"])
def test_what_is_no_field_is_an_error(name: str) -> None:
    with pytest.raises(ConfigError, match=r"no field|not there"):
        LatestFields([name], ["a"], registry=TypeRegistry())
