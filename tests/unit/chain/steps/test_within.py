from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

from riot_bus.chain.steps.analyze import analyze
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.chain.steps.within import analyze_within
from riot_bus.events import AnalysisFinished, StepFinished, StepStarted, StepStopped, TimeLeft
from riot_bus.findings.records import CampaignRecord, MinimalRecord, RuleRecord
from tests.unit.chain.machine import always, bench, never_hangs

SECONDS = 1000.0


def fast(step: float = 20.0) -> Callable[[], float]:
    """Return a clock on which so many seconds pass each time when it is looked at."""
    looks = count()
    return lambda: time.monotonic() + step * next(looks)


def test_without_a_finding_all_of_the_time_is_for_trials(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=never_hangs)
    assert analyze_within(one.workspace, "drive", SECONDS, now=fast()) == []
    assert [event.step for event in one.told(StepStarted)].count("test") == 1
    assert CampaignRecord.load(one.workspace.out).stopped == "the time is over"


def test_what_is_found_is_explained_and_the_rest_is_for_further_trials(tmp_path: Path) -> None:
    one = bench(tmp_path)
    (done,) = analyze_within(one.workspace, "drive", SECONDS, now=fast())
    assert (done.stopped, done.unfinished) == ("", False)
    assert RuleRecord.exists(done.folder)
    tested = [event for event in one.told(StepFinished) if event.step == "test"]
    assert len(tested) == 2
    assert tested[0].trials < tested[1].trials  # those of the first are answered by the store
    left = [event.seconds for event in one.told(TimeLeft)]
    assert left == sorted(left, reverse=True)
    assert {event.total for event in one.told(TimeLeft)} == {SECONDS}
    assert one.workspace.until is None


def test_a_unit_that_always_fails_needs_no_further_trials(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=always)
    found = analyze_within(one.workspace, "drive", SECONDS, now=fast(1.0))
    assert [event.step for event in one.told(StepFinished)].count("test") == 1
    assert len(found) == len(one.told(AnalysisFinished))


def test_a_step_whose_time_is_over_is_gone_on_with(tmp_path: Path) -> None:
    one, late = bench(tmp_path), bench(tmp_path)
    late.workspace.until = 0.0
    (folder,) = run_campaign(one.workspace, "drive", trials=30, seconds=None, covered=False)
    stopped = analyze(late.workspace, folder)
    assert stopped.unfinished
    assert "the time was over" in stopped.stopped
    assert [event.step for event in late.told(StepStopped)] == ["minimize"]
    assert not MinimalRecord.exists(folder)
    late.workspace.until = None
    assert not analyze(late.workspace, folder).unfinished
    assert MinimalRecord.exists(folder)
