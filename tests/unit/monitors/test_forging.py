"""A monitor is shown to be able to fire, or why not is said."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import pytest

from riot_bus.monitors.arrivals import Never, Rate, Ratio, Sometimes
from riot_bus.monitors.exchanges import Answered
from riot_bus.monitors.forging import mute_monitors, why_cannot_fire
from riot_bus.monitors.invariants import Finite, Gapless, Range, Values
from riot_bus.monitors.model import Monitor, TrialView
from riot_bus.vocabulary.trial import Violation
from riot_bus_testkit.monitors import trial_view

VIEW = trial_view(
    [("a", {"x": 1.5, "n": 1, "t": "calm"}), ("a", {"x": 1.6, "n": 2, "t": "calm"}), ("say", {})],
    inputs=[("ask", {})],
)


class Mute:
    def judge(self, view: TrialView) -> Sequence[Violation]:
        return []

    def forge(self, view: TrialView) -> TrialView:
        return view


class Unforged:
    def judge(self, view: TrialView) -> Sequence[Violation]:
        return []


@pytest.mark.parametrize(
    "monitor",
    [
        Range("a:x", min=0, max=2),
        Range("a:n", max=2),
        Range("a:n", min=1),
        Finite("a:x"),
        Values("a:n", allowed=(0, 1, 2)),
        Values("a:n", allowed=(0,), mask=0x80),
        Gapless("a:n"),
        Gapless("a:n", lost=3),
        Rate("a", gap=0.25),
        Never("alarm"),
        Never("a where x > 1.7 and x < 1.8 and (n == 7 or n == 8)"),
        Never('a where t == "fire" and x != 1.6'),
        Never("a where x == nan"),
        Sometimes("a where x > 1"),
        Ratio("a", "ask", 1, 3),
        Ratio("a", "ask", 0, 3),
        Answered("ask", answer="say", within=0.2),
    ],
)
def test_the_shipped_ones_fire_on_a_forged_copy(monitor: Monitor) -> None:
    before = list(VIEW.outputs)
    assert why_cannot_fire(monitor, VIEW) is None
    assert VIEW.outputs == before


@pytest.mark.parametrize(
    ("monitor", "reason"),
    [
        (Values("a:n", allowed=tuple(range(2048)), mask=0x7), "can hold no value"),
        (Never("a where x > 2 and x < 1"), "cannot be made|can be made"),
        (Never("b where x > 2"), "no message of 'b' came"),
        (Range("a:x", max=1), "the trial itself violates it: a:x = 1.5 is outside"),
        (Rate("b", gap=9.0), "no message of 'b' came"),
        (Mute(), "silent on a trial"),
        (Unforged(), "no method `forge`"),
    ],
)
def test_one_that_cannot_is_told_with_the_reason(monitor: Monitor, reason: str) -> None:
    assert re.search(reason, why_cannot_fire(monitor, VIEW) or "")


def test_monitors_that_stay_silent_where_they_must_fire_are_told_and_no_others() -> None:
    class Silent(Mute):
        topics = ("a",)

    monitors = [Finite("a:x"), Finite("b:x"), Unforged(), Silent(), Finite("a:t")]
    assert mute_monitors(VIEW, monitors) == ("Silent a: it is silent on a trial that is to violate it",)


def test_a_busy_machine_makes_none_mute() -> None:
    busy = replace(trial_view([("odom", {"x": 1.0})] * 3), held_up=0.3)
    assert mute_monitors(busy, [Rate("odom", gap=0.2)]) == ()
