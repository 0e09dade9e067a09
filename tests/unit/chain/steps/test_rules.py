from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.steps.rules import _spread, _typed, rules
from riot_bus.findings.records import FieldsRecord, ProportionRecord, RuleRecord
from riot_bus.findings.steps import find_step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import LearnedRule, Variable, learn_rule
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from tests.unit.chain.machine import MODE, SPEED, SYSTEM, bench, rated, sometimes, write_fields, write_minimal


def test_the_rule_says_when_the_unit_fails(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one, SPEED, MODE)
    record = one.workspace.carry_out(find_step("rules"), one.folder, budget=60)
    assert isinstance(record, RuleRecord)
    assert f"{MODE} == 'step'" in record.text.replace('"', "'")
    assert SPEED in record.text
    assert record.balanced_accuracy >= 0.95
    rule = Rule.from_json(record.rule)
    assert list(rule.predict({MODE: ["step", "step", "hold"], SPEED: [-3.0, 30.0, -3.0]})) == [True, False, False]
    assert set(record.scale) == {SPEED, MODE}
    assert {sample.failed for sample in record.samples} == {True, False}
    assert record.checks >= record.recall.total > 0
    assert record.in_context is not None
    assert record.in_context.count == record.in_context.total == 24
    assert (record.own_mistakes, record.own_mistake) == (0, {})
    assert (record.topics, record.context) == (("command",), ())
    assert not (one.folder / "context.mcap").exists()
    context = "right in 24 of 24 trials that start with nominal messages"
    told = f"on {record.checks} fresh checks, {context}, {record.trials} trials)"
    assert record.summary.endswith(told)


@pytest.mark.parametrize("leave", ["", 'leave = ["command:mode"]\n'])
def test_fields_that_are_left_alone_are_not_varied_to_check_the_rule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, leave: str
) -> None:
    varied: set[str] = set()

    def learn(*given: Any, context: Sequence[Variable], **more: Any) -> LearnedRule:
        varied.update(each.name for each in context)
        return learn_rule(*given, context=context, **more)

    monkeypatch.setattr("riot_bus.chain.steps.rules.learn_rule", learn)
    one = bench(tmp_path, SYSTEM + leave)
    write_minimal(one)
    write_fields(one, SPEED)
    one.workspace.carry_out(find_step("rules"), one.folder, budget=40)
    assert varied == ({"command:note"} if leave else {"command:note", MODE})


def test_a_rate_without_trials_behind_it_is_not_told() -> None:
    rate = ProportionRecord(value=1.0, low=0.0, high=1.0)
    rule = RuleRecord(
        text="isnan(x)", rule={}, python="", precision=rate, recall=rate, balanced_accuracy=1.0, checks=60, scale={}
    )
    assert rule.summary == "fails when isnan(x) (tested with one outcome only: 0 of 60 fresh checks failed, 0 trials)"
    none = rule.model_copy(update={"checks": 0})
    assert none.summary == "fails when isnan(x) (not tested: no fresh checks were possible, 0 trials)"


@pytest.mark.parametrize(("rate", "false", "told"), [(0.9, 0.01, (18, 20)), (0.3, 0.0, (6, 20)), (1.0, 0.0, (4, 4))])
def test_rules_of_failures_that_come_sometimes(
    tmp_path: Path, rate: float, false: float, told: tuple[int, int]
) -> None:
    one = bench(tmp_path, wrong=sometimes(rate, false))
    write_minimal(one)
    write_fields(one, SPEED, MODE)
    rated(one, *told)
    record = rules(one.run(), one.folder, budget=60, validation=30)
    odd = [one for one in record.samples if one.failed != (one.values[MODE] == "step" and one.values[SPEED] < 1)]
    assert len(odd) <= 2
    assert f"{MODE} == " in record.text
    assert f"{SPEED} < " in record.text
    assert record.balanced_accuracy >= 0.95
    assert record.in_context is not None
    assert record.in_context.count >= record.in_context.total - 1
    each = len(one.machine.executed) / (len(record.samples) + record.in_context.total)
    assert each <= {0.9: 5, 0.3: 16, 1.0: 1.2}[rate]


def test_a_failing_log_that_passes_is_inconclusive(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: True)
    write_minimal(one)
    write_fields(one, SPEED)
    with pytest.raises(InconclusiveError):
        rules(one.run(), one.folder, budget=20, validation=10)


def test_without_a_relevant_field_there_is_no_rule(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one)
    with pytest.raises(InconclusiveError, match="no field of the minimal log is relevant"):
        rules(one.run(), one.folder)
    assert one.machine.executed == []


def test_a_field_that_was_not_confirmed_is_named(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one)
    record = FieldsRecord.load(one.folder).model_copy(update={"unconfirmed": (SPEED,)})
    record.save(one.folder)
    with pytest.raises(InconclusiveError, match=f"did not confirm that {SPEED} is relevant"):
        rules(one.run(), one.folder)


def test_the_step_before_is_needed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    with pytest.raises(ConfigError, match=r"fields\.json does not exist yet[^`]*`riot relevance"):
        rules(one.run(), one.folder)


def test_bytes_are_read_back_and_spreads_are_never_zero() -> None:
    assert _typed("00ff", b"x") == b"\x00\xff"
    assert _typed("00ff", "x") == "00ff"
    assert [_spread(some) for some in ([], [3], ["a"], [2.0, 4.0])] == [1.0, 1.0, 1.0, 1.0]
    assert _spread([0, 10]) == 5.0
