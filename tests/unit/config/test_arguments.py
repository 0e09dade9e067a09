from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.config.arguments import parse_size, size_text


def test_sizes_as_people_write_them() -> None:
    assert [size_text(each) for each in (0, 999, 1000, 24_646, 2_500_000, 10**9, 3 * 10**15)] == [
        "0 B", "999 B", "1.0 kB", "24.6 kB", "2.5 MB", "1.0 GB", "3000.0 TB",
    ]  # fmt: skip


@given(st.integers(0, 10**15))
def test_sizes_are_those_that_options_take(size: int) -> None:
    text = size_text(size).replace(" ", "")
    assert abs(parse_size(text, "--size") - size) <= size * 0.051 + 1
