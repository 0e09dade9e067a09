from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.permeability import permeability
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.steps import find_step
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import (
    COUNT,
    LOGGED,
    MODE,
    SPEED,
    SYSTEM,
    bench,
    commands,
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
    assert record.summary == "3 external fields in 32 runs of machine -> panel:knob, panel:lever"
    driven = [case for case in one.machine.executed if case.injections]
    assert len(driven) == 32
    assert all(isinstance(injection.value, Signal) for case in driven[:8] for injection in case.injections)
    assert len({case.seed for case in driven}) == 32


def test_a_log_of_the_outside_is_enough(tmp_path: Path) -> None:
    write_nominal(tmp_path)
    one = bench(tmp_path, LOGGED)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert (record.permeable, record.runs, record.played) == (("panel:knob",), 8, True)
    played = "the outside played from the nominal log"
    assert record.summary == f"3 external fields in 8 runs of machine, {played} -> panel:knob"
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
    assert record.summary == "3 external fields in 32 runs of machine -> panel:knob"


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
    monkeypatch.setattr("riot_bus.chain.permeability._ALPHA", 1.0)  # everything is significant at first
    monkeypatch.setattr("riot_bus.chain.permeability._ALPHA_AGAIN", 0.005)
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one, SPEED)
    record = permeability(one.run(), one.folder)
    assert (record.permeable, record.runs) == (("panel:knob",), 12)
    driven = [case for case in one.machine.executed if case.injections]
    assert len({case.seed for case in driven}) == len({case.digest() for case in driven}) == 12


def test_failures_in_perturbed_runs_do_not_matter(tmp_path: Path) -> None:
    one = bench(tmp_path, system_wrong=lambda case: bool(case.injections) and share(case) < 0.5)
    write_minimal(one)
    write_fields(one, SPEED)
    assert permeability(one.run(), one.folder).permeable == ("panel:knob",)


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
    with pytest.raises(ConfigError, match=r"fields\.json is not there yet"):
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
    assert left_out.endswith("-> panel:knob (2 fields not driven: no way from there)")
