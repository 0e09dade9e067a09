"""A component that never stands still is ready and settled when it is as busy as without input."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from riot_bus.processes.launcher import Launcher
from riot_bus.system.system_file import RunPace
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup

pytestmark = pytest.mark.integration

TICKER = """
import json, sys, time
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
subscriber = session.declare_subscriber("ask", lambda sample: None)
while True:
    time.sleep(float(sys.argv[2]))
"""
HALF_THE_SLOWER_TIMER = 20.0
"""Switches a second. Without timers there are some, too: a thread of Zenoh's for callbacks has ten."""
SYSTEM = """
[components.part]
command = ["{python}", "ticker.py", "{endpoint}", "PERIOD"]
inputs = ["ask"]
ready = { timeout = 60 }
"""


@pytest.mark.parametrize(("period", "restless"), [("0.005", True), ("0.025", True), ("3600", False)])
def test_timers_are_told_from_work(tmp_path: Path, period: str, *, restless: bool) -> None:
    """A pause between two ticks is no rest: 25 ms of it were once, after which 30 ms never came."""
    (tmp_path / "ticker.py").write_text(TICKER)
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM.replace("PERIOD", period))
    context = open_system(path)
    with Launcher() as launcher, TrialSetup(context, launcher, tmp_path, segments=["system"]) as setup:
        setup.start("part", seed=0)
        begin = time.monotonic()
        setup.readiness.wait_ready(["part"])
        assert time.monotonic() - begin < 50
        assert setup.observation.idle.switches > HALF_THE_SLOWER_TIMER or not restless
        assert setup.observation.settle(["part"], window=0.03, timeout=20.0, idle=setup.observation.idle)
        assert setup.observation.settle(["part"], window=0.03, timeout=1.0) is not restless
        assert (setup.observation.measure_timers(["part"]).switches > HALF_THE_SLOWER_TIMER) is restless


def test_what_a_start_leaves_to_do_is_no_timer(tmp_path: Path) -> None:
    """Failing trials waited for timers that there were not: 4.5 s instead of one."""
    naps = "for _ in range(40):\n    time.sleep(0.01)\nwhile True:"
    (tmp_path / "ticker.py").write_text(TICKER.replace("while True:", naps))
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM.replace("PERIOD", "3600"))
    context = open_system(path)
    with Launcher() as launcher, TrialSetup(context, launcher, tmp_path, segments=["system"]) as setup:
        setup.start("part", seed=0)
        setup.readiness.wait_ready(["part"])
        assert (
            setup.observation.measure_timers(["part"]).switches < HALF_THE_SLOWER_TIMER
        )  # the naps would be a hundred a second


@pytest.mark.parametrize(("period", "restless"), [("0.025", True), ("3600", False)])
def test_what_ready_components_do_is_known_after_three_starts(tmp_path: Path, period: str, *, restless: bool) -> None:
    """Further starts take it over, and are ready only when they do no more than that."""
    (tmp_path / "ticker.py").write_text(TICKER)
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM.replace("PERIOD", period))
    context, measured = open_system(path), []
    with Launcher() as launcher:
        for number in range(5):
            with TrialSetup(context, launcher, tmp_path, segments=["system"]) as setup:
                setup.start("part", seed=number)
                setup.readiness.wait_ready(["part"])
                measured.append(setup.observation.idle)
                assert setup.observation.settle(["part"], window=0.03, timeout=20.0, idle=setup.observation.idle)
    (known,) = context.idle.values()
    assert known == measured[:3]
    assert measured[3] == measured[4] == sorted(known, key=lambda each: each.switches)[1]
    assert (measured[4].switches > HALF_THE_SLOWER_TIMER) is restless


def test_components_that_are_started_otherwise_are_measured_anew(tmp_path: Path) -> None:
    (tmp_path / "ticker.py").write_text(TICKER)
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM.replace("PERIOD", "{speed}"))
    context = open_system(path)
    with Launcher() as launcher:
        for speed in (0.025, 3600.0):
            with TrialSetup(context, launcher, tmp_path, segments=["system"]) as setup:
                setup.start("part", seed=0, pace=RunPace(duration=1, speed=speed))
                setup.readiness.wait_ready(["part"])
                assert (setup.observation.idle.switches > HALF_THE_SLOWER_TIMER) is (speed < 1)
    assert [len(each) for each in context.idle.values()] == [1, 1]
