"""Rules of units that remember: what earlier messages set decides, and the minimal log has none of it."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.steps.rules import rules
from riot_bus.chain.unit.contexts import ask_in_contexts
from riot_bus.chain.unit.prediction import explained, predict, predict_log
from riot_bus.chain.unit.questions import UnitQuestions
from riot_bus.cli.main import make_app
from riot_bus.findings.records import (
    CertificateRecord,
    FieldRecord,
    FieldsRecord,
    FindingRecord,
    MinimalRecord,
    ProportionRecord,
    RuleRecord,
)
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.log.writer import LogWriter
from riot_bus.trial.baseline import Baseline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict
from tests.tiers import scaled
from tests.unit.chain.machine import HANG, Bench, bench, said

SYSTEM = """
[system]
name = "machine"
[components.drive]
command = ["drive"]
inputs = ["setup", "pick"]
[unit.drive]
log = "log.mcap"
"""
DEFAULT = 100


def message(number: int, topic: str, **values: object) -> Message:
    payload = json.dumps(values).encode()
    return Message(10**18 + number * 50_000_000, topic, payload, encoding="application/json", sequence=number)


def nominal(size: int) -> list[Message]:
    draw = random.Random(size)
    log = [message(0, "setup", size=size, note=1.5)]
    for number in range(1, 60):
        if number % 20:
            log.append(message(number, "pick", index=draw.randrange(size // 2), gain=draw.uniform(1, 2)))
        else:
            log.append(message(number, "setup", size=size + number, note=draw.uniform(1, 2)))
    return log


def beyond(messages: Sequence[Message]) -> int | None:
    """The unit indexes an array whose size `setup` sets; before that it has 100 elements."""
    size = DEFAULT
    for place, one in enumerate(messages):
        values = said(one)
        if one.key == "setup":
            size = values["size"]
        elif isinstance(values["index"], int) and values["index"] >= size:
            return place
    return None


def finding(folder: Path, size: int, **machine: object) -> Bench:
    """Write what `minimize` and `relevance` make of the failure: one message, whose index was injected."""
    one = bench(folder, SYSTEM, **machine)
    with LogWriter(folder / "log.mcap") as writer:
        for each in nominal(size):
            writer.write(each)
    bad, good = message(7, "pick", index=2**31 - 1, gain=1.0), message(7, "pick", index=3, gain=1.0)
    one.folder.mkdir(parents=True)
    FindingRecord(
        id="hang-drive-1", system="machine", system_file=str(one.workspace.context.file.path), unit="drive",
        component="drive", monitor="hang", signature=HANG.signature, messages=1, modified=1,
    ).save(one.folder)  # fmt: skip
    FailingLog((bad,), {7: good}).save(one.folder / "minimal.mcap", context=one.workspace.context, metadata={})
    MinimalRecord(before=60, kept=(7,), topics=("pick",), one_minimal=True).save(one.folder)
    certificate = CertificateRecord(
        failing=2**31 - 1, passing=3, failing_log="", passing_log="", confirmed_failing=3, confirmed_passing=3,
        repeats=3,
    )  # fmt: skip
    field = FieldRecord(name="pick:index", kind="exceptional", type="int64", failing=2**31 - 1, certificate=certificate)
    FieldsRecord(fields=(field,), considered=("pick:index", "pick:gain"), bound=0.2, straight=12).save(one.folder)
    return one


@pytest.mark.parametrize("size", [40, 5000])
@pytest.mark.parametrize("seed", range(scaled(4)))
def test_what_an_earlier_message_set_is_in_the_rule(tmp_path: Path, size: int, seed: int) -> None:
    one = finding(tmp_path, size, fails=beyond)
    one.workspace.seed = seed
    record = rules(one.run(), one.folder, budget=100)
    record.save(one.folder)
    rule = Rule.from_json(record.rule)
    assert rule.variables == ("pick:index", "setup:size")
    pairs = [(index, size) for size in (1, 7, 100, 4000, 10**6) for index in (-1, 0, size - 1, size, size + 1, 2**31)]
    held = rule.predict(
        {"pick:index": np.array([i for i, _ in pairs]), "setup:size": np.array([size for _, size in pairs])}
    )
    assert list(held) == [index >= size for index, size in pairs], record.text
    assert (record.topics, record.context) == (("setup", "pick"), ("setup",))
    assert record.in_context is not None
    assert record.in_context.count == record.in_context.total >= 12
    log = FailingLog.load(one.folder / "context.mcap", registry=TypeRegistry())
    assert [each.key for each in log.messages] == ["setup", "pick"]
    assert beyond(log.messages) == 1
    assert [said(each)["index"] for each in log.originals.values()] == [3]
    found = predict(rule, record.topics, nominal(size), registry=TypeRegistry())
    assert (found.fails, found.unknown) == (0, 0)
    told = predict_log(one.folder / "context.mcap", one.folder)
    assert (told.judged, told.fails) == (1, 1)
    assert told.lines()[0].startswith(f"would fail: the rule {record.text} holds at 1 of 1 message")
    with pytest.raises(InconclusiveError, match="never decide whether"):
        predict_log(one.folder / "minimal.mcap", one.folder)


def test_a_rule_is_held_against_what_a_campaign_has_tried(tmp_path: Path) -> None:
    """A failure that the rule does not know of is told; trials in which it cannot be judged do not count."""

    def fails(messages: Sequence[Message]) -> int | None:
        odd = [place for place, one in enumerate(messages) if said(one).get("gain") == -7.0]
        return odd[0] if odd else beyond(messages)

    one = finding(tmp_path, 40, fails=fails)
    log = one.workspace.unit_log("drive")
    index = [Injection("pick", "index", value, first=5, last=5) for value in (39, 40, 41, 50, 10**6, -1, 0)]
    gain = Injection("pick", "gain", -7.0, first=9, last=9)
    late = Injection("setup", fault="drop", first=0, last=0)
    unset = (late, Injection("pick", "index", 500, first=2, last=2))
    cases = [TestCase(log, each, 3) for each in (*((each,) for each in index), (gain,), unset, (late,))]
    outcomes = one.run().unit_runner("drive").run(cases)
    failed = [outcome.verdict is Verdict.FAIL for outcome in outcomes]
    assert failed == [False, *[True] * 4, False, False, True, True, False]
    record = rules(one.run(), one.folder, budget=100)
    assert record.in_campaign is not None
    assert (record.in_campaign.count, record.in_campaign.total, record.missed) == (7, 8, 1)
    assert (record.unjudged, record.keeps) == (2, False)
    assert "and 7 of 8 of the campaign, of which 1 failed though it does not hold; 2 further" in record.summary
    often, seldom = (explained(record, one.run(), "drive", HANG.signature, rate=rate) for rate in (1.0, 0.5))
    assert (often.holds, seldom.holds) == ((0, 0), (4, 4))


@pytest.mark.parametrize("keeps", [True, False])
def test_trials_show_whether_a_missing_size_leaves_the_earlier_one_in_force(tmp_path: Path, *, keeps: bool) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        size = DEFAULT
        for place, one in enumerate(messages):
            if one.key == "setup":
                size = said(one).get("size", size if keeps else DEFAULT)
            elif said(one)["index"] >= size:
                return place
        return None

    one = finding(tmp_path, 40, fails=fails)
    omit = Injection("setup", "size", fault="omit", first=1, last=1)
    early = Injection("pick", "index", 50, first=10, last=10)
    changed = [(omit, Injection("pick", "index", value, first=25, last=25)) for value in (39, 50, 99, 100)]
    log = one.workspace.unit_log("drive")
    outcomes = one.run().unit_runner("drive").run([TestCase(log, each, 3) for each in (*changed, (early,))])
    assert sum(outcome.verdict is Verdict.FAIL for outcome in outcomes) == (4 if keeps else 2)
    beyond_size = Rule(((Literal(Feature("sub", ("pick:index", "setup:size")), ">=", 0),),))
    sure = ProportionRecord(value=1, low=0.9, high=1, count=9, total=9)
    record = RuleRecord(
        text=beyond_size.text(), rule=beyond_size.to_dict(), precision=sure, recall=sure, balanced_accuracy=1.0,
        scale={}, topics=("setup", "pick"),
    )  # fmt: skip
    found = explained(record, one.run(), "drive", HANG.signature)
    assert (found.keeps, found.trials, found.wrong, found.unknown) == ((True, 5, [], 0) if keeps else (False, 1, [], 4))


def test_trials_of_a_campaign_got_the_probe_too(tmp_path: Path) -> None:
    """The unit fails at a nominal message that follows the log: so the rule says."""
    probe = (message(0, "pick", index=150, gain=1.0),)
    one = finding(tmp_path, 200, fails=beyond, alone=Baseline(trials=3, probe=probe, probe_answers={"picked": 1}))
    MinimalRecord.load(one.folder).model_copy(update={"unprobed": True}).save(one.folder)
    small = [(Injection("setup", "size", size, first=2, last=2),) for size in (101, 151)]
    log = one.workspace.unit_log("drive")
    outcomes = one.run().unit_runner("drive").run([TestCase(log, each, 3) for each in small])
    assert [outcome.verdict is Verdict.FAIL for outcome in outcomes] == [True, False]
    record = rules(one.run(), one.folder, budget=100)
    assert record.in_campaign is not None
    assert (record.in_campaign.count, record.in_campaign.total) == (2, 2)


@pytest.mark.parametrize("holds", [True, False])
def test_a_rule_may_hold_before_the_last_message_of_a_trial_behind_others(tmp_path: Path, holds: bool) -> None:
    one = finding(tmp_path, 200, fails=beyond)
    questions = UnitQuestions(one.run(), one.folder)
    asked, context = [{"pick:index": 70}, {"pick:index": 7}], (message(0, "setup", size=50, note=1.5),)
    (answers,) = ask_in_contexts(questions, [context], asked, [False, False], lambda messages: holds)
    assert answers.failed == (True, False)
    assert answers.wrong == ([] if holds else [0])


def test_the_command_says_where_a_log_fails(tmp_path: Path) -> None:
    one = finding(tmp_path, 40, fails=beyond)
    rules(one.run(), one.folder, budget=60).save(one.folder)
    log = tmp_path / "other.mcap"
    with LogWriter(log) as writer:
        for each in (message(0, "setup", size=5), *(message(n, "pick", index=n) for n in range(1, 8))):
            writer.write(each)
    told = CliRunner().invoke(make_app("predict"), ["predict", str(log), str(one.folder)])
    assert told.exit_code == 1
    assert told.stdout.splitlines()[1] == "  0.250 s, message 5: pick:index = 5, setup:size = 5"
    told = CliRunner().invoke(make_app("predict"), ["predict", str(log), str(one.folder), "--format=json"])
    assert [each["message"] for each in json.loads(told.stdout)["moments"]] == [5, 6, 7]
    good = CliRunner().invoke(make_app("predict"), ["predict", str(tmp_path / "log.mcap"), str(one.folder)])
    assert (good.exit_code, good.stdout.partition(":")[0]) == (0, "would not fail")
    with LogWriter(log) as writer:
        for each in (message(0, "pick", index=50), message(1, "setup", size=500), message(2, "pick", index=1)):
            writer.write(each)
    open_ = CliRunner().invoke(make_app("predict"), ["predict", str(log), str(one.folder)])
    assert (open_.exit_code, open_.stdout.partition(":")[0]) == (5, "not known whether it would fail")
    open_ = CliRunner().invoke(make_app("predict"), ["predict", str(log), str(one.folder), "--format=json"])
    assert (open_.exit_code, json.loads(open_.stdout)["would_fail"]) == (5, None)


def test_a_rule_that_no_context_explains_stays_and_says_how_often_it_is_wrong(tmp_path: Path) -> None:
    """What the unit does after 30 messages has nothing to do with any one of them."""

    def tired(messages: Sequence[Message]) -> int | None:
        place = beyond(messages)
        return place if place is None or len(messages) < 25 else None

    one = finding(tmp_path, 200, fails=tired)
    record = rules(one.run(), one.folder, budget=60)
    assert record.in_context is not None
    assert record.in_context.count < record.in_context.total
    assert f"right in {record.in_context.count} of {record.in_context.total} trials" in record.summary


def test_a_unit_that_answers_otherwise_later_keeps_the_rule_it_has(tmp_path: Path) -> None:
    """What was brought in does not fail again: no reason to end the step, nor to keep the new rule."""

    def fails(messages: Sequence[Message]) -> int | None:
        place = beyond(messages)
        several = len({one.key for one in messages}) > 1
        return None if several and len(messages) < 20 else place

    one = finding(tmp_path, 40, fails=fails)
    (one.folder / "context.mcap").write_bytes(b"of an earlier rule")
    record = rules(one.run(), one.folder, budget=60)
    assert record.text.startswith("pick:index")
    assert record.in_context is not None
    assert record.in_context.total > 0
    assert (one.folder / "context.mcap").exists() == bool(record.context)
