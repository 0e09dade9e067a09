from __future__ import annotations

import json
import logging

import pytest

from riot_bus.events import (
    AnalysisFinished,
    CampaignFinished,
    Listeners,
    RunEvent,
    StepFinished,
    StepProgress,
    StepStarted,
)


def test_events_are_plain_values() -> None:
    event = CampaignFinished("drive", 9, 2, exhausted=True, findings=("a", "b"), seconds=1.5)
    assert json.loads(json.dumps(event.as_json())) == {
        "event": "CampaignFinished", "unit": "drive", "trials": 9, "failing": 2, "exhausted": True,
        "findings": ["a", "b"], "seconds": 1.5,
    }  # fmt: skip
    assert StepFinished("rules", "x < 1", 2.0).as_json()["record"] is None


def test_all_are_told_in_order() -> None:
    told: list[tuple[int, RunEvent]] = []
    tell = Listeners([lambda event: told.append((1, event)), lambda event: told.append((2, event))])
    first, second = StepStarted("test"), StepProgress("test", 1, None, "")
    tell(first)
    tell(second)
    assert told == [(1, first), (2, first), (1, second), (2, second)]


def test_a_listener_that_raises_is_reported_once_and_stops_nothing(caplog: pytest.LogCaptureFixture) -> None:
    told: list[RunEvent] = []

    def broken(event: RunEvent) -> None:
        raise ZeroDivisionError

    tell = Listeners([broken, told.append])
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            tell(AnalysisFinished("f", "r", ""))
    assert len(told) == 3
    assert caplog.text.count("a listener failed (broken on AnalysisFinished)") == 1
    assert "ZeroDivisionError" in caplog.text


def test_interruptions_get_through() -> None:
    def stop(event: RunEvent) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Listeners([stop])(StepStarted("test"))
