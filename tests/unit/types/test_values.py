from __future__ import annotations

import math
from functools import partial

import pytest

from riot_bus.types import values as module
from riot_bus.types.json_type import JsonType
from riot_bus.types.values import fit_value, set_field
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar


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
