"""The same frame over several links."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_mavlink.bridge.duplicates import Duplicates

STEPS = st.lists(st.tuples(st.integers(0, 12), st.sampled_from([b"a", b"b", b"c"])), max_size=40)


@given(STEPS)
def test_seen_within_the_period(steps: list[tuple[int, bytes]]) -> None:
    duplicates = Duplicates(1.0)
    now = 0.0
    last: dict[bytes, float] = {}
    for tenths, raw in steps:
        now += tenths / 8
        assert duplicates.seen(raw, now) == (raw in last and now - last[raw] < 1.0)
        last[raw] = now


def test_what_is_remembered_is_bounded() -> None:
    duplicates = Duplicates(1e9, most=10)
    for number in range(1000):
        assert not duplicates.seen(b"%d" % number, number / 1000)
    assert duplicates.seen(b"999", 1)
    assert not duplicates.seen(b"1", 1)
    assert len(duplicates._last) <= 11
