from __future__ import annotations

from typing import Literal

import pytest

from riot_bus.findings.activation import ActivationRecord, RangeRecord, RegionRecord


@pytest.mark.parametrize(
    ("ends", "text"),
    [
        ((), "-100 <= goal <= 20.5"),
        (("low",), "goal <= 20.5 (tried from -100 on)"),
        (("high",), "goal >= -100 (tried up to 20.5)"),
        (("low", "high"), "goal anywhere from -100 to 20.5, as far as was tried"),
    ],
)
def test_nothing_is_said_of_what_was_not_tried(ends: tuple[Literal["low", "high"], ...], text: str) -> None:
    goal = RangeRecord(field="goal", low=-100.0, high=20.5, ends=ends)
    region = RegionRecord(ranges=(goal, RangeRecord(field="speed", low=0.0, high=1.0)))
    assert region.bounds() == (text, "0 <= speed <= 1")
    assert region.bounds(lambda one: f"<{one}>")[1] == "<0.0> <= speed <= <1.0>"


def test_a_replay_rate_needs_replays() -> None:
    activation = ActivationRecord(found={"x": 1.0}, runs=8, best_distance=-1.0)
    assert activation.replay_rate is None
    assert activation.model_copy(update={"replays": 4, "replays_failed": 3}).replay_rate == 0.75
