from __future__ import annotations

import json
import random
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.steps.activation import activation
from riot_bus.chain.steps.reproduce import reproduce
from riot_bus.chain.whole.driven_system import DrivenSystem
from riot_bus.events import Listeners, RunEvent, StepProgress
from riot_bus.findings.activation import ActivationRecord, PointRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FindingRecord, ProportionRecord, RuleRecord, RuleSample
from riot_bus.findings.steps import find_step
from riot_bus.generalize.rules import Variable, learn_rule
from riot_bus.log.reader import read_log
from riot_bus.log.writer import LogWriter
from riot_bus.report.page import write_report
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Series, TestCase
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.query import Query
from riot_bus_fleet.scan import scan_logs
from tests.interop import OPTUNA, importable
from tests.tiers import scaled
from tests.unit.chain.machine import (
    COUNT,
    LOGGED,
    OTHER,
    SPEED,
    SYSTEM,
    Bench,
    bench,
    commands,
    hangs,
    never_hangs,
    panel,
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
    knob, lever = region.ranges
    assert (knob.field, lever.field) == ("panel:knob", "panel:lever")
    assert knob.high < 30
    assert (knob.ends, lever.ends) == (("low",), ("high",))
    assert "(tried from -1000 on) and panel:lever >= 0.5" in region.text
    assert region.inside is not None
    assert region.inside.count == region.inside.total
    assert {point.phase for point in record.points} == {"search", "again", "needed", "region"}
    assert (record.needed, record.needed_proven) == (1, True)
    rule = RuleRecord.load(one.folder / "region")
    assert region.rule == rule.text == f"panel:knob <= {knob.high:g} and panel:lever >= {lever.low:g}"
    assert len(f"{knob.high:g}") <= 3  # 20, for example: no more digits than the runs need
    assert (rule.checks, rule.precision.total, rule.recall.total) == (0, 0, 0)  # no fresh run tested it
    assert (rule.scale.keys(), rule.types["panel:lever"]) == ({"panel:knob", "panel:lever"}, "float64")
    with Catalogue(None) as known:
        index(known, [str(one.folder / "activation.mcap")])
        (scanned,) = scan_logs(one.folder / "region", known.find(Query())).logs
    assert scanned.distance < 0
    smaller = record.trials - (len(record.points) + record.replays + record.controls)
    assert 0 < smaller <= 20
    assert record.summary.startswith(f"activated after {record.runs} runs with panel:knob = ")
    replays = "; 10 of 10 replays of 60 external messages fail, 0 of 10 with nominal inputs; "
    assert f"{replays}1 external message is enough; region " in record.summary


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


def test_what_made_the_system_fail_in_permeability_already_is_tried_first(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow)
    known = PermeabilityRecord.load(one.folder)
    known.model_copy(update={"failing": ({"panel:knob": -40.0, "panel:lever": 0.9, "panel:heat": 41.0},)}).save(
        one.folder
    )
    record = activation(one.run(), one.folder, budget=60)
    assert (record.runs, record.found) == (1, {"panel:knob": -40.0})


def test_a_point_that_replays_seldom_gives_way_to_one_farther_inside(tmp_path: Path, slow: dict[str, Any]) -> None:
    """Close to what passes, a replay fails half of the time only."""

    def passes(case: TestCase) -> bool:
        return bool(case.messages) and min(said(one)["knob"] for one in case.messages) > 15 and share(case) < 0.5

    one = ready(tmp_path, slow, ("panel:knob", 0.9), system_wrong=passes)
    known = PermeabilityRecord.load(one.folder)
    known.model_copy(update={"failing": ({"panel:knob": 19.0},)}).save(one.folder)
    record = activation(one.run(), one.folder, budget=60)
    assert record.runs == 1
    assert record.found is not None
    assert record.found["panel:knob"] < 15
    assert (record.replays, record.replays_failed, record.needed) == (10, 10, 1)
    assert f"with panel:knob = {record.found['panel:knob']:g}; 10 of 10 replays" in record.summary
    assert {said(message)["knob"] for message in read_log(one.folder / "activation.mcap")} == {
        record.found["panel:knob"]
    }


def test_runs_that_were_held_up_and_say_nothing_are_repeated(tmp_path: Path, slow: dict[str, Any]) -> None:
    records, late = [], list[TestCase]()
    for held_up in (0.0, 9.0):
        folder = tmp_path / f"{held_up:g}"
        folder.mkdir()
        one = ready(folder, slow)
        plain = one.machine.drive

        def drive(case: TestCase, *options: Any, plain: Any = plain, held_up: float = held_up) -> Outcome:
            found: Outcome = plain(case, *options)
            if not held_up or case.again or not case.injections or found.violations or share(case) > 0.4:
                return found
            late.append(case)
            nothing = dict.fromkeys(found.observed, Series((), ()))
            return replace(found, observed=nothing, statistics={**found.statistics, "held_up": held_up})

        one.machine.drive = drive  # type: ignore[method-assign]
        records.append(one.workspace.carry_out(find_step("activate"), one.folder, budget=60))
        repeated = [case for case in one.machine.executed if case.again == 1 and case.injections]
        assert [replace(case, again=1) for case in late] == repeated
    usual, held = records
    assert isinstance(usual, ActivationRecord)
    assert isinstance(held, ActivationRecord)
    assert late
    assert (held.found, held.runs, held.points) == (usual.found, usual.runs, usual.points)


def test_one_permeable_field_has_an_interval(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9))
    record = activation(one.run(), one.folder, budget=60)
    assert record.found is not None
    assert record.region is not None
    (knob,) = record.region.ranges
    assert (knob.field, knob.low, knob.ends) == ("panel:knob", -1000, ("low",))
    assert 15 < knob.high < 25
    assert record.replays == 10


def leaning(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that takes what is hot from the knob."""
    found = []
    for reading in readings:
        values = said(reading)
        payload = json.dumps(
            {"mode": "step", "speed": (values["knob"] - values["heat"]) / 20, "note": "panel"}
        ).encode()
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


def warm(messages: Sequence[Message]) -> int | None:
    """The drive fails far from what is nominal only."""
    return next((place for place, message in enumerate(messages) if said(message)["speed"] < -5), None)


def test_a_zone_that_is_no_box_is_told_by_a_rule_that_is_tested(tmp_path: Path, slow: dict[str, Any]) -> None:
    strengths = ("panel:knob", 0.9), ("panel:heat", 0.8)
    one = ready(tmp_path, slow, *strengths, governor=leaning, system_fails=warm)
    record = activation(one.run(), one.folder, budget=100)
    assert record.found is not None
    region = record.region
    assert region is not None
    rule = RuleRecord.load(one.folder / "region")
    assert region.rule == rule.text == "panel:knob - panel:heat < -100"
    assert rule.checks == 20
    assert rule.precision.value >= 0.9
    assert f"the zone is not a box, it fails when {rule.text} (" in region.text
    assert "check" in {point.phase for point in record.points}


def test_a_search_that_finds_nothing_says_how_near_it_came(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.9), system_fails=never_hangs)
    (one.folder / "region").mkdir()
    record = activation(one.run(), one.folder, budget=4)
    assert (record.found, record.runs, record.replays, record.region) == (None, 4, 0, None)
    assert not (one.folder / "region").exists()  # that of an earlier search is not this one's
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
    assert "but was not shown to fail more often there than with nominal inputs" in record.summary
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


def after_a_pulse(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that follows the knob once the lever has been up and down again."""
    high = down = False
    found = []
    for reading in readings:
        values = said(reading)
        high = high or values["lever"] > 0.9
        down = down or (high and values["lever"] < 0.1)
        speed = values["knob"] / 20 if down else 3.0
        payload = json.dumps({"mode": "step", "speed": speed, "note": "panel"}).encode()
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


@pytest.mark.parametrize("seed", range(scaled(10, gate=2)))
def test_inputs_vary_in_time_where_constant_ones_do_not_suffice(
    tmp_path: Path, slow: dict[str, Any], seed: int
) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9), ("panel:lever", 0.6), governor=after_a_pulse)
    one.workspace.seed = seed
    record = one.workspace.carry_out(find_step("activate"), one.folder, budget=300)
    assert isinstance(record, ActivationRecord)
    assert record.found is not None
    assert (record.replays, record.replays_failed, record.region) == (10, 10, None)
    readings = read_log(one.folder / "activation.mcap")
    assert hangs(after_a_pulse(readings)) is not None
    levers = [said(message)["lever"] for message in readings]
    assert max(levers) > 0.9
    assert min(levers) < 0.1
    assert "panel:lever" in record.text
    assert ActivationRecord.load(one.folder).found == record.found


def limps(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that trusts the heat."""
    found = []
    for reading in readings:
        heat = said(reading)["heat"]
        speed = 0.0 if heat != heat else 3.0  # NaN
        payload = json.dumps({"mode": "step", "speed": speed, "note": "panel"}).encode()
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


@pytest.mark.parametrize("fails", [hangs, never_hangs])
def test_a_failure_of_values_that_are_not_finite_is_searched_with_such_values(
    tmp_path: Path, slow: dict[str, Any], fails: Any
) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.9), ("panel:knob", 0.6), governor=limps, system_fails=fails)
    samples = (RuleSample(values={SPEED: float("nan")}, failed=True), RuleSample(values={SPEED: 3.0}, failed=False))
    RuleRecord.load(one.folder).model_copy(update={"samples": samples}).save(one.folder)
    record = one.workspace.carry_out(find_step("activate"), one.folder, budget=60)
    assert isinstance(record, ActivationRecord)
    if fails is never_hangs:
        assert (record.found, record.runs) == (None, 9)
        assert "so only such values were tried" in record.summary
        return
    assert record.found is not None
    assert record.found["panel:heat"] != record.found["panel:heat"]
    assert set(record.found) == {"panel:heat"}
    assert (record.replays_failed, record.region, record.runs) == (10, None, 4)
    assert "panel:heat = nan" in record.text


def test_where_no_field_can_have_what_the_unit_fails_with_nothing_is_tried_and_that_is_said(
    tmp_path: Path, slow: dict[str, Any]
) -> None:
    system = SYSTEM.replace("[external.ranges]", '[external.values]\n"panel:*" = [1.0, 2.0]\n\n[external.ranges]')
    one = ready(tmp_path, slow, ("panel:knob", 0.9), system=system)
    samples = (RuleSample(values={SPEED: float("inf")}, failed=True),)
    RuleRecord.load(one.folder).model_copy(update={"samples": samples}).save(one.folder)
    record = one.workspace.carry_out(find_step("activate"), one.folder)
    assert isinstance(record, ActivationRecord)
    assert (record.found, record.runs, record.points) == (None, 0, ())
    assert record.summary.startswith("not tested: the unit failed with values that are not finite only")


def geared(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that follows the knob in reverse gear only."""
    found = []
    for reading in readings:
        values = said(reading)
        speed = values["knob"] / 20 if values["gear"] == "reverse" else 3.0
        payload = json.dumps({"mode": "step", "speed": speed, "note": values["gear"]}).encode()
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


def test_runs_outside_the_region_count_where_they_had_its_other_values(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow)
    system = DrivenSystem(one.run(), one.folder, (), names=["panel:knob", "panel:lever"])
    values: list[dict[str, float]] = [
        {"panel:knob": 10.0, "panel:lever": 1.0},
        {"panel:lever": 1.0},
        {"panel:knob": 10.0},
        {"panel:knob": 10.0, "panel:lever": 0.0},
        {"panel:knob [part 1]": 10.0, "panel:lever": 1.0},
    ]
    system.points = [PointRecord(values=each, distance=None, failed=True) for each in values]  # type: ignore[arg-type]
    knob = system.fields["panel:knob"].nominal
    seen = system.seen(["panel:knob"], {"panel:lever": 1.0})
    assert [(each.place, each.failed) for each in seen] == [((10.0,), True), ((knob,), True)]
    nominal = system.seen(["panel:knob"], {})
    assert [each.place for each in nominal[:4]] == [(10.0,), (knob,), (10.0,), (10.0,)]
    assert [(each.place, each.failed) for each in nominal[4:]] == [((knob,), False)] * 10


STATED = '[external.values]\n"panel:gear" = ["first", "second", "reverse"]\n\n[external.ranges]'
GEARS = LOGGED.replace("[external.ranges]", STATED)


def test_texts_that_riot_toml_states_are_driven_and_named(tmp_path: Path, slow: dict[str, Any]) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        readings = [
            reading.with_(payload=json.dumps(said(reading) | {"gear": "first"}).encode()) for reading in panel(0)
        ]
        for pair in zip(readings, geared(readings), strict=True):
            for message in pair:
                writer.write(message)
    one = ready(tmp_path, slow, system=GEARS, governor=geared)
    write_fields(one, SPEED)
    reached = one.workspace.carry_out(find_step("permeability"), one.folder)
    assert isinstance(reached, PermeabilityRecord)
    assert set(reached.permeable) == {"panel:gear", "panel:knob"}
    record = activation(one.run(), one.folder, budget=100)
    assert record.found is not None
    assert record.found["panel:gear"] == "reverse"
    assert "panel:gear = reverse" in record.text
    assert {said(message)["gear"] for message in read_log(one.folder / "activation.mcap")} == {"reverse"}
    assert record.replays_failed == 10
    assert record.region is not None
    assert [each.field for each in record.region.ranges] == ["panel:knob"]
    assert ", with panel:gear = reverse: " in record.region.text


ONCE = LOGGED.replace('name = "machine"', 'name = "machine"\ntrial_run = { duration = 1 }').replace(
    '["panel"]', '["panel", "goal"]'
)


@pytest.mark.parametrize("alone", [False, True])
def test_a_field_whose_messages_do_not_come_in_a_run_is_not_searched_and_that_is_said(
    tmp_path: Path, slow: dict[str, Any], alone: bool
) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in [*panel(0), Message(10**18 + 2 * 10**9, "goal", b'{"x": 1.0}')]:
            writer.write(message)
    strengths = [("goal:x", 0.8), *([] if alone else [("panel:knob", 0.9)])]
    one = ready(tmp_path, slow, *strengths, system=ONCE)
    record = activation(one.run(), one.folder, budget=40)
    unset = "goal:x: no message came within the 1 s of a run that could be changed in it"
    if alone:
        assert (record.found, record.runs, record.text) == (None, 0, f"not tested: {unset}")
        assert one.machine.executed == []
        return
    assert record.found is not None
    assert set(record.found) == {"panel:knob"}
    assert record.text.endswith(f"; not tried: {unset}")
    assert not any("goal:x" in point.values for point in record.points)


def test_a_field_that_components_never_publish_is_not_searched(tmp_path: Path, slow: dict[str, Any]) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in [*panel(0), Message(10**18 + 2 * 10**9, "goal", b'{"x": 1.0}')]:
            writer.write(message)
    system = SYSTEM.replace('name = "machine"', 'name = "machine"\nnominal = "nominal.mcap"')
    one = ready(
        tmp_path, slow, ("goal:x", 0.8), system=system.replace('topics = ["panel"]', 'topics = ["panel", "goal"]')
    )
    record = activation(one.run(), one.folder, budget=40)
    assert (record.found, record.runs) == (None, 0)
    assert record.text.startswith("not tested: goal:x: no message came within the ")


def test_other_failures_of_nominal_runs_and_of_replays_are_told(tmp_path: Path, slow: dict[str, Any]) -> None:
    def other(case: Any) -> bool:
        return not case.injections

    def wrong(case: Any) -> bool:
        return not case.injections and not case.paced  # nominal inputs, but no replay

    write_nominal(tmp_path)
    one = ready(tmp_path, slow, ("panel:knob", 0.9), system=LOGGED, system_wrong=wrong, other=other)
    record = activation(one.run(), one.folder, budget=60)
    assert (record.controls, record.controls_failed, record.controls_others) == (10, 0, {OTHER.signature: 10})
    assert (record.replays, record.replays_failed, record.replays_others) == (10, 0, {OTHER.signature: 10})
    assert f"10 runs with nominal inputs failed otherwise: {OTHER.signature}" in record.summary
    assert f"10 replays failed otherwise: {OTHER.signature}" in record.summary


def test_where_the_limits_of_a_field_keep_the_search_from_the_rule_that_is_said(
    tmp_path: Path, slow: dict[str, Any]
) -> None:
    one = ready(tmp_path, slow, ("panel:knob", 0.9), system=SYSTEM.replace("[-1000, 1000]", "[30, 1000]"))
    record = activation(one.run(), one.folder, budget=40)
    assert record.found is None
    assert record.text.endswith("; of constant values, the nearest are at the end of what may be tried for panel:knob")


def test_without_a_permeable_field_the_outside_cannot_be_searched(tmp_path: Path, slow: dict[str, Any]) -> None:
    one = ready(tmp_path, slow, ("panel:heat", 0.1))
    with pytest.raises(InconclusiveError, match="no external field was found to reach the relevant ones"):
        activation(one.run(), one.folder)


def test_the_steps_before_are_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    with pytest.raises(ConfigError, match=r"fields\.json does not exist yet"):
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
    # the nominal run; a look whether the field can be set; answers of the one are none of the other
    assert len(one.machine.executed) == 1 + 5 + 5


TUNED = """
[external.parameters]
gain = { nominal = 1.0, range = [-2.0, 2.0] }
profile = { nominal = "calm", values = ["calm", "sport"] }

[external.ranges]"""


def test_parameters_of_commands_are_inputs_like_fields(tmp_path: Path, slow: dict[str, Any]) -> None:
    """The drive is only driven backwards by another gain, in another profile."""
    write_nominal(tmp_path)
    one = ready(tmp_path, slow, system=LOGGED.replace("[external.ranges]", TUNED))
    machine = one.machine

    def tuned(readings: Sequence[Message]) -> list[Message]:
        gain = machine.parameters.get("gain", 1.0) if machine.parameters.get("profile") == "sport" else 1.0
        return [
            each.with_(payload=json.dumps({"mode": "step", "speed": 3.0 * gain, "note": ""}).encode())
            for each in commands(readings)
        ]

    machine.governor = tuned
    write_fields(one, SPEED)
    reached = one.workspace.carry_out(find_step("permeability"), one.folder)
    assert isinstance(reached, PermeabilityRecord)
    assert set(reached.permeable) <= {"param:gain", "param:profile"}
    assert reached.permeable
    parameters = [edge for edge in reached.edges if edge.external.startswith("param:")]
    assert {edge.external for edge in parameters} == {"param:gain", "param:profile"}
    assert "within runs" not in {edge.design for edge in parameters}
    edges = tuple(edge.model_copy(update={"permeable": True}) for edge in parameters)  # one may not show by itself
    reached.model_copy(update={"edges": edges}).save(one.folder)
    record = one.workspace.carry_out(find_step("activate"), one.folder, budget=100)
    assert isinstance(record, ActivationRecord)
    assert record.found is not None
    assert record.found["param:profile"] == "sport"
    assert record.found["param:gain"] < 1 / 3
    assert (record.replays, record.replays_failed, record.messages) == (10, 10, COUNT)
    assert "param:profile = sport" in record.text
    assert reproduce(one.workspace, one.folder, times=3, whole_system=True).answer == "still failing"


def loaded(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that slows down by how much is on the belt."""
    return [
        each.with_(payload=json.dumps({"mode": "step", "speed": 5.0 - len(values["belt"]), "note": ""}).encode())
        for each, values in ((each, said(reading)) for each, reading in zip(commands(readings), readings, strict=True))
    ]


def test_the_length_of_an_array_is_an_input(tmp_path: Path, slow: dict[str, Any]) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for number, reading in enumerate(panel(0)):
            reading = reading.with_(payload=json.dumps(said(reading) | {"belt": [1.0] * (number % 3)}).encode())
            for message in (reading, *loaded([reading])):
                writer.write(message)
    one = ready(tmp_path, slow, system=LOGGED, governor=loaded)
    write_fields(one, SPEED)
    reached = one.workspace.carry_out(find_step("permeability"), one.folder)
    assert isinstance(reached, PermeabilityRecord)
    assert reached.permeable == ("panel:len(belt)",)
    record = activation(one.run(), one.folder, budget=100)
    assert record.found is not None
    assert record.found["panel:len(belt)"] > 4
    assert record.replays_failed == 10
    assert record.region is not None
    assert record.region.rule == "panel:len(belt) >= 5"


def ageing(readings: Sequence[Message]) -> list[Message]:
    """What a governor says at each beat that slows down by the age of what the panel has said last."""
    known, found = None, []
    for reading in sorted(readings, key=lambda each: each.time):
        if reading.key == "panel":
            known = reading.time
            continue
        age = 1.0 if known is None else min(1.0, (reading.time - known) / 1e9)
        payload = json.dumps({"mode": "step", "speed": 3.0 - 4.0 * age, "note": ""}).encode()
        found.append(Message(reading.time + 1000, "command", payload, sequence=reading.sequence))
    return found


def test_messages_that_are_late_or_lost_are_inputs(tmp_path: Path, slow: dict[str, Any]) -> None:
    beats = [Message(each.time + 10_000_000, "beat", b"{}", sequence=each.sequence) for each in panel(0)]
    readings = [message for pair in zip(panel(0), beats, strict=True) for message in pair]
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in sorted([*readings, *ageing(readings)], key=lambda each: each.time):
            writer.write(message)
    timed = LOGGED.replace("[external.ranges]", 'timing = ["panel"]\n\n[external.ranges]\n"*:#delay" = [0, 2]')
    timed = timed.replace('topics = ["panel"]', 'topics = ["panel", "beat"]').replace(
        'inputs = ["panel"]', 'inputs = ["panel", "beat"]'
    )
    one = ready(tmp_path, slow, system=timed, governor=ageing)
    write_fields(one, SPEED)
    reached = one.workspace.carry_out(find_step("permeability"), one.folder)
    assert isinstance(reached, PermeabilityRecord)
    assert set(reached.permeable) == {"panel:#delay", "panel:#loss"}
    record = activation(one.run(), one.folder, budget=100)
    assert record.found is not None
    assert record.replays_failed == 10
    assert hangs(ageing(read_log(one.folder / "activation.mcap"))) is not None
    assert "panel:#" in record.text
    assert not (one.folder / "region").exists(), "no log has such fields"


def test_a_search_may_be_shared_as_a_study(tmp_path: Path, slow: dict[str, Any]) -> None:
    importable(OPTUNA, "optuna")
    url = f"sqlite:///{tmp_path / 'studies.db'}"
    first = ready(tmp_path, slow, ("panel:knob", 0.9), system_fails=never_hangs)
    record = activation(first.run(), first.folder, budget=30, study=url)
    assert (record.found, record.runs) == (None, 30)
    import optuna

    (study,) = optuna.get_all_study_summaries(url)
    assert study.n_trials == 30
    assert study.study_name.startswith("machine hang-drive-1 ")


def test_what_was_found_is_kept_where_the_time_ends_while_its_region_is_measured(
    tmp_path: Path, slow: dict[str, Any]
) -> None:
    one = ready(tmp_path, slow)

    def end(event: RunEvent) -> None:
        if isinstance(event, StepProgress) and event.note.startswith("boundary"):
            one.workspace.until = 0.0

    one.workspace.tell = Listeners([one.events.append, end])
    record = one.workspace.carry_out(find_step("activate"), one.folder, budget=60)
    assert isinstance(record, ActivationRecord)
    assert (record.region, record.replays, record.replays_failed, record.controls) == (None, 10, 10, 10)
    assert record.text.endswith("the region around it was not measured to its end: the time was over")
    assert record.text in record.summary
