from __future__ import annotations

import pytest

from riot_bus.vocabulary.counting import counted


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs"), (-1, "-1 runs"), (12345, "12345 runs")]
)
def test_one_is_singular_and_all_else_plural(count: int, text: str) -> None:
    assert counted(count, "run") == text


def test_thousands_can_be_marked() -> None:
    assert counted(1234567, "message", mark="'") == "1'234'567 messages"
