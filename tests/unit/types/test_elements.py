"""Elements of arrays, read as a whole."""

from __future__ import annotations

import json
import math

import pytest

from riot_bus.types.elements import read_elements, read_field
from riot_bus.types.json_type import JsonType
from riot_bus.vocabulary.elements import MOST_ELEMENTS
from riot_bus.vocabulary.errors import PayloadError

KIND = JsonType()


def payload(**values: object) -> bytes:
    return json.dumps(values).encode()


def test_elements_and_fields_of_records_are_read() -> None:
    data = payload(r=[3, 1.5], poses=[{"x": 1, "y": 2}, {"x": 5, "y": 9}], rr=[7], n=4)
    assert read_elements(KIND, data, "r[*]") == (3, 1.5)
    assert read_elements(KIND, data, "poses[*].x") == (1, 5)
    assert read_field(KIND, data, "max(poses[*].y)") == 9
    assert read_field(KIND, data, "min(r[*])") == 1.5
    assert read_field(KIND, data, "n") == 4


def test_an_empty_array_has_no_largest_element() -> None:
    largest = read_field(KIND, payload(r=[]), "max(r[*])")
    assert isinstance(largest, float)
    assert math.isnan(largest)
    assert read_field(KIND, payload(r=[]), "isnan(r[*])") is False


@pytest.mark.parametrize(
    ("path", "message"),
    [("q[*]", "no such array"), ("r[*]", "more than"), ("names[*]", "not all elements"), ("n[*]", "no such array")],
)
def test_what_is_no_array_of_numbers_is_told(path: str, message: str) -> None:
    data = payload(r=[0] * (MOST_ELEMENTS + 1), names=["a", 1], n=4)
    with pytest.raises(PayloadError, match=message):
        read_elements(KIND, data, path)
