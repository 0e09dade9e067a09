from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.steps.analyze import analyze, budget_within
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.findings.records import CampaignRecord, RuleRecord
from riot_bus.findings.steps import STEPS
from tests.unit.chain.machine import Bench, bench

MINIMIZE, RELEVANCE, RULES, PERMEABILITY, ACTIVATE = STEPS[1:]
REST = (RULES, PERMEABILITY, ACTIVATE)


@pytest.fixture
def tested(tmp_path: Path) -> tuple[Bench, Path]:
    one = bench(tmp_path)
    (folder,) = run_campaign(one.workspace, "drive", trials=30, seconds=None, covered=False)
    record = CampaignRecord.load(one.workspace.out)
    record.model_copy(update={"trials": 100, "seconds": 10.0}).save(one.workspace.out)
    return one, folder


def test_enough_time_limits_nothing(tested: tuple[Bench, Path]) -> None:
    one, folder = tested
    assert [budget_within(one.workspace, folder, REST[first:], 1e5) for first in range(3)] == [{}, {}, {}]


def test_each_step_gets_its_part_of_little_time(tested: tuple[Bench, Path]) -> None:
    one, folder = tested
    pace = one.workspace.context.file.system
    runs = [8 * (pace.perturbed_run.duration + 0.3), 120 * (pace.trial_run.duration + 0.3)]
    rules = 260 * 0.1  # seconds, at the rate of the campaign
    all_of_it = rules + sum(runs) / one.workspace.jobs
    assert budget_within(one.workspace, folder, REST, all_of_it / 2) == {"budget": 80}
    assert budget_within(one.workspace, folder, REST[1:], sum(runs) / one.workspace.jobs) == {"runs": 5}
    (budget,) = budget_within(one.workspace, folder, REST[2:], runs[1] / one.workspace.jobs / 2).values()
    assert budget == 30  # as many again repeat failing runs


def test_no_step_gets_less_than_its_option_allows(tested: tuple[Bench, Path]) -> None:
    one, folder = tested
    assert [budget_within(one.workspace, folder, REST[first:], 0.0) for first in range(3)] == [
        {"budget": 10},
        {"runs": 2},
        {"budget": 1},
    ]


def test_steps_that_end_by_themselves_and_those_of_others_are_not_limited(tested: tuple[Bench, Path]) -> None:
    one, folder = tested
    other = RULES._replace(name="mine")
    assert budget_within(one.workspace, folder, (MINIMIZE, *REST), 1.0) == {}
    assert budget_within(one.workspace, folder, (RELEVANCE, *REST), 1.0) == {}
    assert budget_within(one.workspace, folder, (other, *REST), 1.0) == {}


def test_a_rule_learnt_in_little_time_has_fewer_trials(tmp_path: Path) -> None:
    trials = []
    for name, left in (("short", lambda: 1.0), ("long", None)):
        (tmp_path / name).mkdir()
        one = bench(tmp_path / name)
        (folder,) = run_campaign(one.workspace, "drive", trials=30, seconds=None, covered=False)
        assert analyze(one.workspace, folder, left=left).stopped == ""
        trials.append(RuleRecord.load(folder).trials)
    assert trials[0] < trials[1]
