"""Rate, never, sometimes, reached and count: when and how often outputs come."""

from __future__ import annotations

from dataclasses import replace

import pytest

from riot_bus.monitors.arrivals import Rate, Ratio, Reached, Sometimes
from riot_bus.monitors.forging import mute_monitors
from riot_bus.monitors.model import Judgement, judge
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.monitors import trial_view

SECOND = 10**9


def test_a_rate_counts_from_the_first_input() -> None:
    view = trial_view([("out", {})], step=10.0)
    assert Rate("out", gap=5.0).judge(view) != []
    late = replace(view, inputs=[view.outputs[0].with_(key="in")], end=13 * SECOND)
    assert Rate("out", gap=5.0).judge(late) == []
    assert Rate("out", gap=2.0).judge(late)[0].detail == "no out for 3.000 s (allowed: 2 s)"


def test_sometimes_wants_one_message_that_meets_the_condition() -> None:
    view = trial_view([("state", {"phase": 1}), ("state", {"phase": 4})])
    assert Sometimes("state where phase == 4").judge(view) == []
    (found,) = Sometimes("state where phase == 5").judge(view)
    assert found.signature == "never reached: state where phase == 5"
    assert found.detail == "of 2 messages of 'state': none meets 'phase == 5'"
    (found,) = Sometimes("stat").judge(view)
    assert "did you mean 'state'" in found.detail


def test_what_one_trial_of_a_campaign_has_to_reach_is_no_violation_of_a_trial() -> None:
    view = trial_view([("state", {"phase": 1}), ("state", {"phase": 4})])
    assert judge(view, [Reached("state where phase == 4")]) == Judgement()
    (told,) = judge(view, [Reached("state where phase == 5")]).unseen
    assert told == "Reached state where phase == 5: not reached: of 2 messages of 'state': none meets 'phase == 5'"
    assert mute_monitors(view, [Reached("state where phase == 4")]) == ()


def test_the_outputs_for_an_input_are_counted() -> None:
    twice = trial_view([("out", {})] * 4, inputs=[("in", {})] * 2)
    assert Ratio("out", "in", 2, 2).judge(twice) == []
    (found,) = Ratio("out", "in", 0.5, 1.5).judge(twice)
    assert found.signature == "count of out for in"
    assert found.detail == "4 of out for 2 of in (2 for one, allowed: 0.5 to 1.5)"
    assert Ratio("other", "in", 0.5, 1.5).judge(twice) != []
    with pytest.raises(ConfigError, match="above"):
        Ratio("out", "in", 2, 1)


def test_a_busy_machine_is_no_gap() -> None:
    view = trial_view([("out", {})] * 3, step=2.0)
    assert Rate("out", gap=1.0).judge(replace(view, held_up=0.9)) != []
    busy = replace(view, held_up=1.5)
    assert judge(busy, [Rate("out", gap=1.0)]).unseen == (
        "Rate out: the machine was busy: outputs may be 1.500 s late, the largest gap is 2.000 s",
    )
    assert judge(busy, [Rate("out", gap=2.5)]) == Judgement()
    assert Rate("out", gap=1.0).judge(replace(trial_view([("out", {})], step=40.0), held_up=3.0)) != []  # 4 % of 80 s
