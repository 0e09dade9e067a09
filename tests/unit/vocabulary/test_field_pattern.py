from __future__ import annotations

import pytest

from riot_bus.vocabulary.field_pattern import names_field


@pytest.mark.parametrize(
    ("pattern", "name", "named"),
    [
        ("scan:ranges[3]", "scan:ranges[3]", True),
        ("scan:ranges[3]", "scan:ranges3", False),
        ("scan:ranges[*]", "scan:ranges[12]", True),
        ("scan:ranges[?]", "scan:ranges[12]", False),
        ("*:header.frame_id", "/scan:header.frame_id", True),
        ("a:*", "a:pose.x[2]", True),
        ("a:x", "a:X", False),
    ],
)
def test_brackets_are_indices(pattern: str, name: str, *, named: bool) -> None:
    assert names_field(pattern, name) is named
