from __future__ import annotations

import pytest

from riot_bus.findings.records import RegionRecord


@pytest.mark.parametrize(
    ("ends", "text"),
    [
        ((), "-100 <= goal <= 20.5"),
        (("x_min",), "goal <= 20.5 (tried from -100 on)"),
        (("x_max",), "goal >= -100 (tried up to 20.5)"),
        (("x_min", "x_max"), "goal anywhere from -100 to 20.5, as far as was tried"),
    ],
)
def test_nothing_is_said_of_what_was_not_tried(ends: tuple[str, ...], text: str) -> None:
    region = RegionRecord(x="goal", y="speed", x_min=-100.0, x_max=20.5, y_min=0.0, y_max=1.0, ends=ends)
    assert region.bounds() == (text, "0 <= speed <= 1")
    assert region.bounds(lambda one: f"<{one}>")[1] == "<0.0> <= speed <= <1.0>"
