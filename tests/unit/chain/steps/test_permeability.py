from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.steps.permeability import permeability
from riot_bus.events import StepProgress
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.steps import find_step
from riot_bus.inject.apply import inject_log
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase
from tests.unit.chain.machine import (
    COUNT,
    LOGGED,
    MODE,
    OTHER,
    SPEED,
    SYSTEM,
    bench,
    commands,
    hangs,
    panel,
    said,
    share,
    write_fields,
    write_minimal,
    write_nominal,
)

OFF = SYSTEM.replace('inputs = ["panel"]', "inputs = []")
"""The same machine, whose riot.toml forgets to say what the governor reads."""


def test_the_field_that_reaches_the_unit_is_told_from_those_that_do_not(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one, SPEED, MODE)
    record = one.workspace.carry_out(find_step("permeability"), one.folder)
    assert isinstance(record, PermeabilityRecord)
    assert record.permeable == ("panel:knob", "panel:lever")
    assert {(edge.external, edge.internal, edge.design) for edge in record.edges if edge.permeable} == {
        ("panel:knob", SPEED, "within runs"),
        ("panel:lever", MODE, "beyond nominal"),
    }
    assert {edge.external for edge in record.edges} == {"panel:knob", "panel:lever", "panel:heat"}
    assert set(record.nominal) == {"panel:knob", "panel:lever", "panel:heat"}
    assert (record.runs, record.trials, record.pruned) == (32, 32, ())  # of the mode nothing was seen within its range
    assert [node["topic"] for node in record.tree] == ["command"]
    assert record.failed == sum(hangs_of(case) for case in one.machine.executed if case.injections) > 0
    assert record.failing
    assert all(one["panel:knob"] < 20 and one["panel:lever"] > 0.5 for one in record.failing)
    told = f"; {record.failed} runs failed as the finding does"
    assert record.summary == "3 external fields in 32 runs of machine -> panel:knob, panel:lever" + told
    tried = {(edge.external, edge.internal): edge.tested for edge in record.edges}
    assert tried["panel:heat", SPEED] == tried["panel:knob", SPEED] == ("within runs", "beyond nominal")
    assert tried["panel:heat", MODE] == ("beyond nominal",)
    driven = [case for case in one.machine.executed if case.injections]
    assert len(driven) == 32
    assert all(isinstance(injection.value, Signal) for case in driven[:8] for injection in case.injections)
    assert len({case.seed for case in driven}) == 32
    said_of = [event for event in one.told(StepProgress) if event.note.startswith("permeability of ")]
    inner = [(event.done, event.total) for event in said_of if "command" in event.note]
    assert inner[0][0] == 1  # what is computed from the runs takes long, too
    assert inner[-1][0] == inner[-1][1] == len({event.note for event in said_of if "command" in event.note})


def hangs_of(case: TestCase) -> bool:
    """Return whether the drive hangs in a run that nothing answers wrongly."""
    readings, _ = inject_log(panel(case.seed), case.injections, registry=TypeRegistry(), seed=case.seed)
    return hangs(commands(readings)) is not None


def test_a_log_of_the_outside_is_enough(tmp_path: Path) -> None:
    write_nominal(tmp_path)
    one = bench(tmp_path, LOGGED)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert (record.permeable, record.runs, record.played) == (("panel:knob",), 8, True)
    played = "the outside played from the nominal log"
    only = "(2 fields without an effect had nominal values only)"
    assert record.summary == f"3 external fields in 8 runs of machine, {played} -> panel:knob {only}"
    none = [edge for edge in record.edges if not edge.permeable]
    assert {edge.tested for edge in none} == {("within runs",)}
    assert all(edge.limits.endswith("nominal values only, never one value for a whole run") for edge in none)
    assert all(edge.detectable is not None and 0 < edge.detectable < 0.5 for edge in none)
    driven = [case for case in one.machine.executed if case.injections]
    assert {len(case.messages) for case in driven} == {COUNT}
    assert {message.key for message in driven[0].messages} == {"panel"}


def latching(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that keeps to the first reading."""
    return [each.with_(time=reading.time + 1000) for reading in readings for each in commands(readings[:1])]


def once(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that gets one reading, at its begin."""
    return (
        latching(readings)
        if len(readings) > 1
        else [
            each.with_(time=each.time + number * 50_000_000) for number in range(COUNT) for each in commands(readings)
        ]
    )


def test_an_input_of_which_only_the_first_value_counts_is_found_between_runs(tmp_path: Path) -> None:
    one = bench(tmp_path, governor=latching)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert record.permeable == ("panel:knob",)
    assert {edge.external: edge.design for edge in record.edges if edge.permeable} == {"panel:knob": "between runs"}
    assert (record.runs, record.untested) == (32, {})
    assert record.summary.startswith(
        "3 external fields in 32 runs of machine -> panel:knob (2 fields without an effect"
    )
    assert {edge.tested for edge in record.edges} == {("within runs", "between runs")}


def test_an_input_that_comes_once_is_found_between_runs(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in [panel(0)[0], *once(panel(0)[:1])]:
            writer.write(message)
    one = bench(tmp_path, LOGGED, governor=once)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert record.permeable == ("panel:knob",)
    assert {edge.external for edge in record.edges} == {"panel:knob", "panel:lever", "panel:heat"}
    assert {edge.design for edge in record.edges} == {"between runs"}


def test_a_text_inside_that_only_changes_beyond_the_nominal_range_is_reached(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one, MODE)
    record = permeability(one.run(), one.folder)
    assert (record.permeable, record.runs) == (("panel:lever",), 32)
    assert [edge.design for edge in record.edges if edge.permeable] == ["beyond nominal"]
    assert record.untested == {}


SHORT = LOGGED.replace('name = "machine"', 'name = "machine"\nperturbed_run = { duration = 1 }').replace(
    '["panel"]', '["panel", "goal"]'
)


def with_goal(readings: Sequence[Message], at: int, **more: object) -> list[Message]:
    """A nominal log of readings in which a goal comes once; from there on, readings have more fields."""
    later = [
        each.with_(payload=json.dumps(said(each) | more).encode()) if place >= at else each
        for place, each in enumerate(readings)
    ]
    goal = Message(readings[at].time + 500, "goal", b'{"x": 1.0}')
    return sorted([*later, *commands(readings), goal], key=lambda each: each.time)


@pytest.mark.parametrize("at", [10, 40])
def test_of_a_field_whose_messages_do_not_come_in_the_runs_nothing_is_told(tmp_path: Path, at: int) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in with_goal(panel(0), at, belt=[1.0] * 5):
            writer.write(message)
    one = bench(tmp_path, SHORT)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    names = {edge.external for edge in record.edges}
    assert {"panel:knob", "panel:lever", "panel:heat"} <= names
    assert record.untested["panel:belt[*]"] == "of an array, only the first 4 elements are driven"
    if at == 10:  # within the second that each run lasts
        assert {"goal:x", "panel:belt[0]"} <= names
        return
    assert record.runs == 8, "nothing is spent on them"
    assert not names & {"goal:x", "panel:belt[0]"}
    assert record.untested["goal:x"] == "no message of its topic came in these runs"
    assert record.untested["panel:belt[0]"] == "no message that came in these runs could be changed in it"
    assert "goal:x" not in record.nominal


def test_of_a_field_that_is_absent_from_what_components_publish_nothing_is_told(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        for message in with_goal(panel(0), 30, belt=[1.0]):
            writer.write(message)
    one = bench(tmp_path, SYSTEM.replace('name = "machine"', 'name = "machine"\nnominal = "nominal.mcap"'))
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)  # the panel itself never says what is on a belt
    assert "panel:belt[0]" not in {edge.external for edge in record.edges}
    assert record.untested["panel:belt[0]"] == "no message that came in these runs could be changed in it"


def cautious(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that refuses readings whose heat is not possible."""
    return commands([each for each in readings if 35 < said(each)["heat"] < 45])


def test_where_values_beyond_nominal_are_refused_no_effect_is_denied(tmp_path: Path) -> None:
    one = bench(tmp_path, governor=cautious)
    write_minimal(one)
    write_fields(one, MODE)
    record = permeability(one.run(), one.folder)
    assert record.edges == ()
    why = "inner fields had far fewer values than in nominal runs where each external field had one value in a run"
    assert record.untested == dict.fromkeys(("panel:knob", "panel:lever", "panel:heat"), why)
    assert record.unseen == {MODE: "it was constant, or had too few values, in every run"}
    assert f"what reaches {MODE} is not known: it was constant" in record.summary


def checked(readings: Sequence[Message]) -> list[Message]:
    """What a governor says that refuses readings whose attitude is no unit quaternion."""
    return commands([each for each in readings if abs(math.hypot(said(each)["w"], said(each)["z"]) - 1) < 0.01])


def test_fields_that_the_system_refuses_are_found_and_do_not_hide_the_others(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "nominal.mcap") as writer:
        readings = [each.with_(payload=json.dumps(said(each) | {"w": 1.0, "z": 0.0}).encode()) for each in panel(0)]
        for pair in zip(readings, checked(readings), strict=True):
            for message in pair:
                writer.write(message)
    one = bench(tmp_path, LOGGED, governor=checked)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert record.permeable == ("panel:knob",)
    assert set(record.untested) == {"panel:w", "panel:z"}
    assert {edge.external for edge in record.edges} == {"panel:knob", "panel:lever", "panel:heat"}
    assert record.runs <= 8 + 24 + 8
    assert "2 fields not tested: inner fields hardly move when it is driven, as if it was refused" in record.summary


def test_a_system_that_hardly_moves_by_itself_has_no_field_that_is_refused(tmp_path: Path) -> None:
    write_nominal(tmp_path)  # of another version, which said more
    one = bench(tmp_path, LOGGED, governor=lambda readings: commands(readings[::7]))
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert not any("refused" in why for why in record.untested.values())


def test_what_may_be_chance_has_to_show_again_in_fresh_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.chain.steps.permeability._ALPHA", 1.0)  # everything is significant at first
    monkeypatch.setattr("riot_bus.chain.steps.permeability._ALPHA_AGAIN", 0.005)
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert (record.permeable, record.runs) == (("panel:knob",), 12)
    driven = [case for case in one.machine.executed if case.injections]
    assert len({case.seed for case in driven}) == len({case.digest() for case in driven}) == 12


def test_failures_in_perturbed_runs_do_not_matter_but_are_told(tmp_path: Path) -> None:
    wrong: dict[str, Any] = {"system_wrong": lambda case: bool(case.injections) and share(case) < 0.5}
    one = bench(tmp_path, **wrong, other=lambda case: share(case) < 0.2)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert record.permeable == ("panel:knob",)
    failed = [share(case) for case in one.machine.executed if case.injections and share(case) < 0.5]
    others = sum(drawn < 0.2 for drawn in failed)
    assert (record.failed, record.others) == (len(failed) - others, {OTHER.signature: others} if others else {})
    assert "as the finding does" in record.summary


def test_runs_that_cannot_be_carried_out_end_the_step(tmp_path: Path) -> None:
    one = bench(tmp_path, broken=lambda case: bool(case.injections))
    write_minimal(one)
    write_fields(one, SPEED)
    with pytest.raises(EnvironmentFaultError, match="no port"):
        permeability(one.run(), one.folder)
    assert not PermeabilityRecord.exists(one.folder)


def test_a_graph_without_a_way_to_the_unit_is_inconclusive_unless_nothing_is_pruned(tmp_path: Path) -> None:
    one = bench(tmp_path, OFF)
    write_minimal(one)
    write_fields(one, SPEED)
    with pytest.raises(InconclusiveError, match="no external topic leads to the relevant fields"):
        permeability(one.run(), one.folder)
    assert permeability(one.run(), one.folder, prune=False, runs=4).permeable == ("panel:knob",)


def test_without_a_relevant_field_nothing_can_be_reached(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one)
    with pytest.raises(InconclusiveError):
        permeability(one.run(), one.folder)


def test_the_step_before_is_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    with pytest.raises(ConfigError, match=r"fields\.json does not exist yet"):
        permeability(one.run(), one.folder)


def test_a_way_through_an_external_component_counts_and_what_is_left_out_is_said(tmp_path: Path) -> None:
    mirror = '[components.mirror]\ncommand = ["mirror"]\nsegment = "shop"\nexternal = true\n'
    mirror += 'inputs = ["panel"]\noutputs = ["reading"]\n\n[external]'
    system = SYSTEM.replace('inputs = ["panel"]', 'inputs = ["reading"]').replace("[external]", mirror)
    one = bench(tmp_path, system)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder, runs=4)
    assert record.permeable == ("panel:knob",)
    left_out = record.model_copy(update={"pruned": ("a:x", "a:y")}).summary
    assert "-> panel:knob (2 fields not driven: no way from there)" in left_out
