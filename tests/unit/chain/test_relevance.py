from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.logs import FailingLog
from riot_bus.chain.relevance import relevance
from riot_bus.findings.records import FieldsRecord
from riot_bus.findings.steps import find_step
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from tests.unit.chain.machine import (
    MODE,
    SPEED,
    SYSTEM,
    always,
    bench,
    command,
    hangs,
    said,
    share,
    write_finding,
    write_minimal,
)


def test_the_fields_that_matter_come_with_two_trials_that_differ_in_them_alone(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    record = one.workspace.carry_out(find_step("relevance"), one.folder)
    assert isinstance(record, FieldsRecord)
    assert {field.name: field.kind for field in record.fields} == {SPEED: "exceptional", MODE: "nominal"}
    assert set(record.considered) == {MODE, SPEED, "command:note"}
    assert record.trials > 0
    for field in record.fields:
        proof = field.certificate
        assert (proof.confirmed_failing, proof.confirmed_passing, proof.repeats) == (3, 3, 3)
        logs = [
            FailingLog.load(one.folder / name, registry=one.workspace.context.registry).messages
            for name in (proof.failing_log, proof.passing_log)
        ]
        (failing,), (passing,) = logs
        assert hangs([failing]) == 0
        assert hangs([passing]) is None
        path = field.name.partition(":")[2]
        assert {name for name, value in said(failing).items() if said(passing)[name] != value} == {path}
    assert record.summary.startswith("3 fields -> command:speed (exceptional), command:mode (nominal) (")


def test_brittle_fields_and_those_left_alone_are_not_considered_unless_they_are_asked_for(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM + 'leave = ["command:no*"]\n')
    write_minimal(one)
    assert set(relevance(one.run(), one.folder).considered) == {MODE, SPEED}
    two = bench(tmp_path, SYSTEM + 'leave = ["command:*"]\ninclude = ["command:note"]\n')
    assert set(relevance(two.run(), two.folder).considered) == {SPEED, "command:note"}


@pytest.mark.parametrize("seed", range(6))
def test_wrong_answers_of_a_noisy_runner_are_corrected_by_repetitions(tmp_path: Path, seed: int) -> None:
    """One answer in twelve is wrong, but for the failing log itself; repetitions have seeds of their own."""

    def wrong(case) -> bool:
        return case.seed == 0 and said(case.messages[0])["speed"] != -5.0 and share(case, seed) < 1 / 12

    one = bench(tmp_path, wrong=wrong)
    write_minimal(one)
    record = relevance(one.run(), one.folder)
    assert SPEED in {field.name for field in record.fields}
    for field in record.fields:
        assert field.certificate.confirmed_failing == field.certificate.confirmed_passing == 3


def test_a_failing_log_that_its_repetitions_contradict_is_inconclusive(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed > 0)
    write_minimal(one)
    with pytest.raises(InconclusiveError):
        relevance(one.run(), one.folder)


def test_a_minimal_log_that_does_not_fail_again_is_inconclusive(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one, speed=5.0)
    with pytest.raises(InconclusiveError):
        relevance(one.run(), one.folder)
    assert not FieldsRecord.exists(one.folder)


def test_a_unit_that_fails_whatever_the_fields_hold_has_no_relevant_field(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=always)
    write_minimal(one)
    record = relevance(one.run(), one.folder)
    assert record.fields == ()
    assert record.summary == "3 fields -> none (0 trials)"  # figures are filled in by `carry_out`


def test_the_step_before_is_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_finding(one, [command("step", 0)], {})
    with pytest.raises(ConfigError, match=r"minimal\.json is not there yet[^`]*`riot minimize"):
        relevance(one.run(), one.folder)
