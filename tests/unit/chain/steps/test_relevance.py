from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.campaign.confirm import CONFIRMATIONS
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.steps.relevance import relevance
from riot_bus.findings.records import FieldsRecord, FindingRecord, ProportionRecord
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
        assert (proof.confirmed_failing, proof.repeats, proof.confirmed_passing, proof.passing_total) == (3, 3, 3, 3)
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
    record = relevance(one.run(), one.folder)
    assert (set(record.considered), record.left) == ({MODE, SPEED}, ("command:note",))
    two = bench(tmp_path, SYSTEM + 'leave = ["command:*"]\ninclude = ["command:note"]\n')
    assert set(relevance(two.run(), two.folder).considered) == {SPEED, "command:note"}


@pytest.mark.parametrize("seed", range(4))
def test_wrong_answers_of_a_noisy_runner_are_asked_again(tmp_path: Path, seed: int) -> None:
    """One answer in twelve is wrong, in each trial anew."""
    one = bench(tmp_path, wrong=lambda case: share(case, seed) < 1 / 12)
    write_minimal(one)
    record = relevance(one.run(), one.folder)
    assert {field.name for field in record.fields} == {SPEED, MODE}
    for field in record.fields:
        proof = field.certificate
        assert proof.confirmed_failing > proof.repeats / 2
        assert proof.confirmed_passing > proof.passing_total / 2


def test_a_failure_that_comes_three_times_in_ten_has_the_same_fields(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: hangs(case.messages) is not None and share(case) > 0.3)
    write_minimal(one)
    known = FindingRecord.load(one.folder)
    rate = ProportionRecord(value=0.3, low=0.1, high=0.6, count=3, total=10)
    known.model_copy(update={"rate": rate}).save(one.folder)
    record = relevance(one.run(), one.folder)
    assert {field.name for field in record.fields} == {SPEED, MODE}
    for field in record.fields:
        proof = field.certificate
        assert proof.confirmed_failing >= 1
        assert proof.confirmed_passing == proof.passing_total >= 8  # fewer passes are not rare enough


def test_a_certificate_that_fresh_trials_contradict_is_told_as_unconfirmed(tmp_path: Path) -> None:
    """The mode matters in the trials of the search alone: certificates are repeated later than these."""

    def wrong(case) -> bool:
        late = any(each.again - CONFIRMATIONS > 1003 for each in one.machine.executed) or case.again > 1023
        return said(case.messages[0])["mode"] != "step" and said(case.messages[0])["speed"] < 1 and late

    one = bench(tmp_path, wrong=wrong)
    write_minimal(one)
    record = relevance(one.run(), one.folder)
    assert {field.name for field in record.fields} == {SPEED}
    assert record.unconfirmed == (MODE,)
    assert "command:mode (unconfirmed)" in record.summary
    assert not (one.folder / "certificates" / "command-mode.failing.mcap").exists()


def test_trials_that_are_spent_leave_what_was_found_and_say_so(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    record = relevance(one.run(), one.folder, budget=20)
    assert not record.complete
    assert SPEED in {field.name for field in record.fields}
    assert record.bound > 0.05
    assert "trials spent before the search had ended" in record.summary


def test_the_other_fields_change_at_most_one_outcome_in_twenty(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    record = relevance(one.run(), one.folder)
    assert record.complete
    assert record.straight == 60
    assert record.bound <= 0.05


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
    others = "at most 5.0% of random values of the others change the outcome (95 %)"
    assert record.summary == f"3 fields -> none (0 trials); {others}"  # figures are filled in by `carry_out`


def test_the_step_before_is_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_finding(one, [command("step", 0)], {})
    with pytest.raises(ConfigError, match=r"minimal\.json does not exist yet[^`]*`riot minimize"):
        relevance(one.run(), one.folder)
