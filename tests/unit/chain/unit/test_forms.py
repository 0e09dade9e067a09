from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.chain.unit.forms import with_forms
from riot_bus.findings.records import FindingRecord, RuleRecord
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_forms.rule_forms import CPP, PYTHON
from tests.unit.chain.machine import MODE, SPEED, bench, write_minimal, write_rule


def records(folder: Path) -> tuple[RuleRecord, FindingRecord, Path]:
    one = bench(folder)
    write_minimal(one)
    write_rule(one)
    return RuleRecord.load(one.folder), FindingRecord.load(one.folder), one.folder


def test_the_files_say_what_they_are_about(tmp_path: Path) -> None:
    record, finding, folder = records(tmp_path)
    told = with_forms(record, finding, folder)
    for name, namespace in (
        (PYTHON, "def is_dangerous(command_mode, command_speed)"),
        (CPP, "namespace riot_hang_drive_1 {"),
    ):
        text = (folder / name).read_text()
        assert namespace in text
        assert "drive fails: hang of drive" in text
        assert "Precision 30 of 30 fresh trials, recall 30 of 30 fresh trials." in text
    assert told.stl == ""
    assert "signals are numbers" in told.stl_missing
    assert RuleRecord.model_validate(json.loads(told.model_dump_json())) == told


def test_what_was_not_tested_is_said_to_be_so(tmp_path: Path) -> None:
    record, finding, folder = records(tmp_path)
    untested = record.precision.model_copy(update={"count": 0, "total": 0})
    with_forms(record.model_copy(update={"precision": untested, "recall": untested}), finding, folder)
    assert "Precision not tested, recall not tested." in (folder / PYTHON).read_text()


def test_a_formula_where_there_is_one(tmp_path: Path) -> None:
    record, finding, folder = records(tmp_path)
    rule = Rule(((Literal(Feature("raw", (SPEED,)), "<", 1),),))
    told = with_forms(record.model_copy(update={"rule": rule.to_dict(), "types": {SPEED: "float64"}}), finding, folder)
    assert (told.stl, told.stl_signals) == ("always (not ((command_speed < 1.0)))", {"command_speed": SPEED})


def test_no_header_of_an_earlier_rule_is_left(tmp_path: Path) -> None:
    record, finding, folder = records(tmp_path)
    with_forms(record, finding, folder)
    large = Rule(((Literal(Feature("mul", (MODE, SPEED)), ">", 2**127),),))
    types = {MODE: "uint64", SPEED: "uint64"}
    with_forms(record.model_copy(update={"rule": large.to_dict(), "types": types}), finding, folder)
    assert (folder / PYTHON).is_file()
    assert not (folder / CPP).exists()


def test_a_kind_of_feature_without_a_form_ends_no_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record, finding, folder = records(tmp_path)
    with_forms(record, finding, folder)

    def refuse(node: object) -> None:
        raise ConfigError("nobody has said yet how it is written elsewhere")

    monkeypatch.setattr("riot_bus.generalize.forms.tree._tree", refuse)
    told = with_forms(record, finding, folder)
    assert told.stl == ""
    assert told.stl_missing
    assert not (folder / PYTHON).exists()
    assert not (folder / CPP).exists()
