from __future__ import annotations

import pytest

from riot_bus.types.fields import FieldType, of_numbers


@pytest.mark.parametrize(
    ("path", "kind", "expected"),
    [
        ("ranges[*]", "float32", True),
        ("pose.covariance[*]", "float64", True),
        ("flags[*]", "bool", True),
        ("names[*]", "string", False),
        ("parts[*]", "bytes", False),
        ("points[*].x", "float64", False),
        ("rows[*].cells[*]", "int32", False),
        ("len(ranges)", "uint32", False),
        ("x", "float64", False),
    ],
)
def test_only_elements_of_one_array_of_numbers_are_such(path: str, kind: str, *, expected: bool) -> None:
    assert of_numbers(FieldType(path, kind)) is expected
