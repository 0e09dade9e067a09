"""Fields and elements of arrays, read and set."""

from __future__ import annotations

import json
import math
from functools import partial

import pytest

from riot_bus.types import elements as module
from riot_bus.types.elements import fit_value, read_elements, read_field, set_field
from riot_bus.types.json_type import JsonType
from riot_bus.vocabulary.elements import MOST_ELEMENTS
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

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


@pytest.mark.parametrize(
    ("value", "before", "fitted"),
    [
        ("inf", 1.0, math.inf),
        (3, 1.5, 3.0),
        (2.0, 7, 2),
        (2.5, 7, 2.5),
        (1, False, True),
        (0.0, True, False),
        ("x", 1, "x"),
    ],
)
def test_values_get_the_kind_of_the_field(value: Scalar, before: Scalar, fitted: Scalar) -> None:
    found = fit_value(value, before)
    assert (found, type(found)) == (fitted, type(fitted))


def test_arrays_with_too_many_elements_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ALL_ELEMENTS", 3)
    kind, to_zero = JsonType(), partial(fit_value, 0)
    assert set_field(kind, b'{"a": [{"b": [1, 2, 3]}, {"b": [4]}], "c": [1, 2, 3, 4]}', "a[*].b[*]", to_zero) == (
        b'{"a": [{"b": [0, 0, 0]}, {"b": [0]}], "c": [1, 2, 3, 4]}'
    )
    for path in ("a[*].b[*]", "a[*].d"):
        with pytest.raises(PayloadError, match="4 elements are more than the 3"):
            set_field(kind, b'{"a": [{"b": [1]}, {"b": [1, 2, 3, 4]}, {"d": 1}, {"d": 2}]}', path, to_zero)
