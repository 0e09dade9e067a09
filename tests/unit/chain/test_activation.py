from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.activation import _axes, activation, least_distance
from riot_bus.findings.records import (
    ActivationRecord,
    EdgeRecord,
    FindingRecord,
    PermeabilityRecord,
    ProportionRecord,
    RuleRecord,
)
from riot_bus.findings.steps import find_step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import Variable, learn_rule
from riot_bus.log.reader import read_log
from riot_bus.report.page import write_report
from riot_bus.sut.baseline import Baseline
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus.vocabulary.trial import Series
from tests.tiers import scaled
from tests.unit.chain.machine import (
    COUNT,
    LOGGED,
    SPEED,
    Bench,
    bench,
    hangs,
    never_hangs,
    said,
    share,
    write_fields,
    write_minimal,
    write_nominal,
    write_permeability,
)


@pytest.fixture(scope="module")
def slow() -> dict[str, Any]:
    """A rule that says: the speed is below one."""
    variable = Variable(SPEED, "float64", -5.0, passing=(3.0,), nominal=(2.5, 3.5), dictionary=())
    learned = learn_rule([variable], lambda asked: [one[SPEED] < 1 for one in asked], seed=0, budget=40, validation=10)
    return learned.rule.to_dict()


def ready(folder: Path, rule: dict[str, Any], *strengths: tuple[str, float], **machine: Any) -> Bench:
    one = bench(folder, **machine)
    write_minimal(one)
    write_fields(one, SPEED)
    sure = ProportionRecord(value=1, low=0.9, high=1, count=10, total=10)
    RuleRecord(
        text="", rule=rule, python="", precision=sure, recall=sure, balanced_accuracy=1, scale={SPEED: 0.5}
    ).save(one.folder)
    write_permeability(one, *(strengths or (("panel:knob", 0.9), ("panel:lever", 0.6), ("panel:heat", 0.1))))
    return one


def test_external_values_are_found_replayed_and_surrounded_by_a_region(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow)
    record = one.workspace.carry_out(find_step("activate"), one.folder, budget=60)
    assert isinstance(record, ActivationRecord)
    assert record.found is not None
    assert (set(record.found), record.unneeded) == ({"panel:knob"}, ("panel:lever",))
    assert record.found["panel:knob"] < 20
    assert (record.replays, record.replays_failed, record.messages) == (10, 10, COUNT)
    assert (record.controls, record.controls_failed, record.chance, record.others) == (10, 0, 0, {})
    assert all(said(message)["knob"] < 20 for message in read_log(one.folder / "activation.mcap"))
    region = record.region
    assert region is not None
    assert (region.x, region.y) == ("panel:knob", "panel:lever")
    assert region.x_max < 30
    assert set(region.ends) == {"x_min", "y_max"}
    assert "(tried from -1000 on) and panel:lever >= 0.5" in region.text
    assert region.inside is not None
    assert region.inside.count == region.inside.total
    assert {point.phase for point in record.points} == {"search", "again", "needed", "region"}
    assert record.trials == len(record.points) + record.replays + record.controls
    assert record.summary.startswith(f"activated after {record.runs} runs with panel:knob = ")
    assert "; 10 of 10 replays of 60 external messages fail, 0 of 10 with nominal inputs; region " in record.summary


def test_a_log_of_the_outside_is_changed_until_the_system_fails(tmp_path: Path, slow: dict[str, Any]) -> None:
    write_nominal(tmp_path)
    one = ready(tmp_path, slow, system=LOGGED)
    record = activation(one.run(), one.folder, budget=60)
    assert record.found is not None
    assert record.found["panel:knob"] < 20
    assert (record.messages, record.replays, record.replays_failed) == (COUNT, 10, 10)
    assert (record.controls, record.controls_failed) == (10, 0)
    assert "; the outside was played from the nominal log; region " in record.summary
    knobs = {said(message)["knob"] for message in read_log(one.folder / "activation.mcap")}
    assert knobs == {record.found["panel:knob"]}


def test_one_permeable_field_has_no_region(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9))
    record = activation(one.run(), one.folder, budget=60)
    assert record.found is not None
    assert record.region is None
    assert record.replays == 10


def test_a_search_that_finds_nothing_says_how_near_it_came(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.9), system_fails=never_hangs)
    record = activation(one.run(), one.folder, budget=4)
    assert (record.found, record.runs, record.replays, record.region) == (None, 4, 0, None)
    assert record.best_distance is not None
    assert not (one.folder / "activation.mcap").exists()
    assert record.summary.startswith("not activated in 4 runs")


def test_failures_of_another_kind_are_not_the_one_that_is_looked_for(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9), other=lambda case: True)
    record = activation(one.run(), one.folder, budget=60)
    assert record.found is None
    assert sum(record.others.values()) > 0
    assert "failed otherwise: " in record.summary


@pytest.mark.parametrize("seed", range(scaled(50, gate=4)))
def test_no_system_is_activated_that_fails_by_itself(tmp_path: Path, slow: dict[str, Any], seed: int) -> None:
    one = ready(
        tmp_path,
        slow,
        ("panel:heat", 0.9),
        ("panel:lever", 0.5),
        system_fails=never_hangs,
        system_wrong=lambda case: case.seed != 0 and share(case, seed) < 0.1,  # 0: the nominal run
    )
    record = activation(one.run(), one.folder, budget=60)
    assert (record.found, record.region) == (None, None)


def test_a_failure_that_comes_three_times_of_ten_is_activated(tmp_path: Path, slow: dict[str, Any]) -> None:
    drawn = random.Random(1)
    one = ready(tmp_path, slow, system_fails=lambda made: hangs(made) if drawn.random() < 0.3 else None)
    record = activation(one.run(), one.folder, budget=100)
    assert record.found is not None
    assert record.found["panel:knob"] < 20
    assert record.controls_failed == 0


def test_a_system_that_fails_by_itself_as_often_is_not_activated(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(
        tmp_path, slow, ("panel:heat", 0.9), system_fails=never_hangs, system_wrong=lambda case: share(case) < 0.3
    )
    record = activation(one.run(), one.folder, budget=20)
    assert (record.found, record.replays, record.region) == (None, 0, None)
    assert 0 < record.controls_failed < record.controls
    assert record.chance > 0
    assert "but was not shown to come more often there than with nominal inputs" in record.summary
    record.save(one.folder)
    told = write_report(one.folder).read_text()
    assert f"it failed at {record.chance} points, but not for certain more often: {record.controls_failed} of" in told
    assert sum(point.phase == "again" for point in record.points) <= 20  # as many as there are for the search


def test_a_failure_that_does_not_come_again_is_told(tmp_path: Path, slow: dict[str, Any]) -> None:
    """A noisy run fails once; its replays pass, and that is what the record says."""
    one = ready(tmp_path, slow, ("panel:knob", 0.9), system_wrong=lambda case: bool(case.messages))
    record = activation(one.run(), one.folder, budget=60)
    assert record.found is not None
    assert (record.replays, record.replays_failed, record.replay_rate) == (10, 0, 0.0)


def test_a_log_that_is_gone_is_taken_from_the_finding_when_the_step_resumes(
    tmp_path: Path, slow: dict[str, Any]
) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9))
    first = activation(one.run(), one.folder, budget=60)
    for log in tmp_path.glob("external-*.mcap"):
        log.unlink()
    count = len(one.machine.executed)
    assert activation(one.run(), one.folder, budget=60) == first
    assert len(one.machine.executed) == count


def test_integer_fields_get_integers(tmp_path: Path, slow: dict[str, Any]) -> None:
    from riot_bus.chain.activation import _System
    from riot_bus.chain.external import ExternalField

    one = ready(tmp_path, slow)
    system = _System(one.run(), one.folder, ())
    whole = ExternalField("panel:knob", "panel", "knob", "int32", 0, 1, 0, 1, (0, 9), 1)
    system.fields["panel:knob"] = whole
    assert (system._value("panel:knob", 2.6), system._value("panel:lever", 0.6)) == (3, 0.6)


def test_the_strongest_field_of_each_relevant_one_comes_first() -> None:
    def edge(external: str, internal: str, strength: float, *, permeable: bool = True) -> EdgeRecord:
        return EdgeRecord(
            external=external, internal=internal, strength=strength, permeable=permeable, low=0, high=1, lag_s=0,
            p_value=0,
        )  # fmt: skip

    edges = (edge("a", "x", 0.9), edge("b", "x", 0.8), edge("c", "y", 0.3), edge("d", "y", 0.9, permeable=False))
    assert _axes(PermeabilityRecord(edges=edges, runs=8)) == ["a", "c", "b"]
    both = (edge("a", "x", 0.9), edge("a", "y", 0.8))
    assert _axes(PermeabilityRecord(edges=both, runs=8)) == ["a"]


def test_the_distance_to_a_rule_is_the_least_over_a_run(slow: dict[str, Any]) -> None:
    rule = Rule.from_json(slow)
    near = least_distance(rule, {SPEED: Series((0.0, 1.0, 2.0), (9.0, 4.0, 7.0))}, {SPEED: 0.5})
    far = least_distance(rule, {SPEED: Series((0.0, 1.0), (9.0, 7.0))}, {SPEED: 0.5})
    assert near is not None
    assert far is not None
    assert 0 < near < far
    assert least_distance(rule, {SPEED: Series()}, {SPEED: 0.5}) is None


def test_without_a_permeable_field_the_outside_cannot_be_searched(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.1))
    with pytest.raises(InconclusiveError, match="no external field was found to reach the relevant ones"):
        activation(one.run(), one.folder)


def test_the_steps_before_are_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    with pytest.raises(ConfigError, match=r"fields\.json is not there yet"):
        activation(one.run(), one.folder)


def test_a_search_method_that_does_not_exist_is_named_before_anything_is_read(tmp_path: Path) -> None:
    nothing: Any = None
    with pytest.raises(ConfigError) as raised:
        activation(nothing, tmp_path, search=["simplx"])
    assert "--search: unknown search method 'simplx'" in str(raised.value)
    assert "did you mean 'simplex'" in str(raised.value)


def test_what_runs_of_the_system_cannot_tell_is_said_and_not_searched(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, known=Baseline(mute=("2 of 4 nominal runs of the whole system did not pass: x",)))
    record = one.workspace.carry_out(find_step("activate"), one.folder)
    assert isinstance(record, ActivationRecord)
    assert (record.found, record.runs, one.machine.executed) == (None, 0, [])
    assert record.summary == "not tested: 2 of 4 nominal runs of the whole system did not pass: x"
    told = write_report(one.folder).read_text()
    assert "whether it fails there was not tested: 2 of 4 nominal runs" in told
    assert "no external inputs were found" not in told


def test_the_unit_is_judged_where_its_monitor_asks_for_nominal_runs(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.9), system_fails=never_hangs)
    activation(one.run(), one.folder, budget=4)
    FindingRecord.load(one.folder).model_copy(update={"monitor": "crash"}).save(one.folder)
    activation(one.run(), one.folder, budget=4)
    assert one.machine.judged == ["drive"]
    assert len(one.machine.executed) == 1 + 4 + 4  # the nominal run; answers of the one are none of the other
