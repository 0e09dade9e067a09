"""Gaps in sequence numbers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.mavlink.losses import LinkLosses


@given(st.integers(0, 255), st.lists(st.integers(0, 255), max_size=40))
def test_gaps_are_counted(first: int, gaps: list[int]) -> None:
    losses = LinkLosses()
    number = first
    assert losses.see(1, 2, number) == 0
    for gap in gaps:
        number = (number + 1 + gap) % 256
        assert losses.see(1, 2, number) == gap
    count = losses.counts()[1, 2]
    assert (count.received, count.lost, count.last) == (len(gaps) + 1, sum(gaps), number)


def test_sources_have_counts_of_their_own_and_are_bounded() -> None:
    losses = LinkLosses()
    for component in (1, 2):
        for number in (5, 6, 7):
            assert losses.see(1, component, number) == 0
    assert [each.lost for each in losses.counts().values()] == [0, 0]
    for source in range(1 << 16):
        losses.see(source >> 8, source & 255, 0)
    assert len(losses.counts()) == 4096
