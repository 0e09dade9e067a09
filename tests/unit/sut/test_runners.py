from __future__ import annotations

import pytest

from riot_bus.sut.runners import slots_for


@pytest.mark.parametrize(
    ("busy", "slots"),
    [(0.0, 2), (0.01, 8), (0.3, 6), (0.5, 4), (0.99, 2), (1.0, 2), (7.5, 2)],
    ids=["unknown", "waits", "third", "half", "most", "one", "many"],
)
def test_trials_that_wait_share_processors_and_none_stays_without(busy: float, slots: int) -> None:
    assert slots_for(busy, 2) == slots
