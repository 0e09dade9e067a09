"""Monitors that are mined from nominal trials rarely alarm on others, and find most faults."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.monitors.arrivals import Rate, Ratio
from riot_bus.monitors.envelope import Envelope
from riot_bus.monitors.forging import why_cannot_fire
from riot_bus.monitors.mined import false_alarms, from_json, mine, to_json
from riot_bus.monitors.model import judge
from riot_bus.testing.monitors import trial_view
from riot_bus.vocabulary.errors import ConfigError

_SPEC = importlib.util.spec_from_file_location("nominal_trials", Path(__file__).with_name("nominal_trials.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
trials = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(trials)
FAULTS = trials.FAULTS


@pytest.mark.parametrize("number", [5, 20])
def test_false_alarms_are_rare_and_most_faults_are_found(number: int) -> None:
    monitors = mine([trials.nominal(seed) for seed in range(number)])
    alarms, runs = false_alarms(monitors, [trials.nominal(10_000 + seed, messages=20) for seed in range(100)])
    assert (alarms, runs) == (0, 100)
    view = trials.nominal(99_999)
    assert judge(view, monitors).violations == ()
    caught = [name for name, fault in FAULTS.items() if judge(fault(view), monitors).violations]
    assert len(caught) >= 0.7 * len(FAULTS), sorted(set(FAULTS) - set(caught))
    assert {"nan", "huge", "silent", "garbage", "flood", "no unit quaternion", "stamps of the past"} <= set(caught)


def test_what_is_mined_of_a_topic() -> None:
    monitors = mine([trials.nominal(seed) for seed in range(8)])
    kinds = [(type(monitor), monitor.topics[0]) for monitor in monitors]
    assert sorted(kinds, key=str) == sorted(
        ((kind, topic) for kind in (Envelope, Rate, Ratio) for topic in ("cmd", "battery")), key=str
    )
    (cmd,) = (each for each in monitors if isinstance(each, Envelope) and each.topic == "cmd")
    assert cmd.bounds["stamp.sec"] == (None, None), "the time of a later trial is outside of all bounds"
    assert cmd.norms == {"pose": (pytest.approx(1.0), pytest.approx(0.01))}
    assert "stamp.sec" in cmd.increasing
    assert all(why_cannot_fire(monitor, trials.nominal(0)) is None for monitor in monitors)


def test_they_are_the_same_after_being_written_and_read() -> None:
    monitors = mine([trials.nominal(seed) for seed in range(3)])
    assert from_json(to_json(monitors)) == monitors
    for wrong in ("{", "{}", '[{"kind": "never"}]', "[3]", '[{"kind": "rate", "topic": "a"}]'):
        with pytest.raises(ConfigError):
            from_json(wrong)


def test_too_few_trials_and_topics_that_are_not_always_there() -> None:
    with pytest.raises(ConfigError, match="too few"):
        mine([trials.nominal(0)] * 2)
    lonely = trials.changed(trials.nominal(3), "battery", lambda document, number: None, start=0)
    assert {each.topics[0] for each in mine([trials.nominal(0), trials.nominal(1), lonely])} == {"cmd"}
    opaque = [replace(trial_view([("a", b"\xff"), ("a", b"\xfe")])) for _ in range(3)]
    assert [type(each) for each in mine(opaque)] == [Rate], "gaps need no type"


NUMBERS = st.floats(-1e9, 1e9) | st.integers(-(2**40), 2**40) | st.booleans()
TRIALS = st.lists(st.lists(NUMBERS, min_size=1, max_size=6), min_size=3, max_size=6)


@settings(max_examples=60, deadline=None)
@given(TRIALS)
def test_what_it_was_mined_from_passes_and_nan_does_not(runs: list[list[float]]) -> None:
    views = [trial_view([("a", {"x": value, "y": [value]}) for value in run]) for run in runs]
    monitors = mine(views)
    assert all(judge(view, monitors).violations == () for view in views)
    assert from_json(to_json(monitors)) == monitors
    broken = trial_view([("a", {"x": float("nan"), "y": [0]})])
    assert any("not finite" in each.signature for each in judge(broken, monitors).violations)
