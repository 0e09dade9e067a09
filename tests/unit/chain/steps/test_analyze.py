from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.chain.base.systems import find_example
from riot_bus.chain.steps.analyze import analyze, analyze_all
from riot_bus.chain.steps.demo import demo
from riot_bus.chain.unit.absence import other_cause
from riot_bus.cli.main import make_app
from riot_bus.events import AnalysisFinished, FindingWritten, StepFinished, StepStarted, StepStopped
from riot_bus.findings.records import Artefact, FindingRecord, MinimalRecord
from riot_bus.findings.steps import STEPS, ChainStep
from riot_bus.report import finding_view as view
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import (
    MODE,
    SPEED,
    SYSTEM,
    bench,
    command,
    never_hangs,
    said,
    write_fields,
    write_finding,
    write_minimal,
)
from tests.unit.chain.steps.test_minimize import failing, nominal_passes

ALONE = SYSTEM[: SYSTEM.index("[external]")] + "[unit.drive]\n"


def test_the_demo_goes_from_nothing_to_the_report_and_then_costs_nothing(tmp_path: Path) -> None:
    one = bench(tmp_path)
    figures = demo(one.workspace, trials=30)
    assert [event.step for event in one.told(StepStarted)] == ["record", *(step.name for step in STEPS)]
    assert [event.step for event in one.told(StepFinished)] == ["record", *(step.name for step in STEPS)]
    assert (figures["minimal_messages"], figures["stopped"]) == (1, None)
    assert set(figures["relevant_fields"]) == {SPEED, MODE}
    assert "panel:knob" in figures["permeable_fields"]
    assert figures["activation_replay_rate"] == 1.0
    assert figures["rule_balanced_accuracy"] >= 0.9
    assert set(figures["trials"]) == {step.name for step in STEPS}
    assert Path(figures["report"]).is_file()
    assert figures["findings"] == [figures["finding"]] == [one.told(FindingWritten)[0].folder]
    assert (one.told(AnalysisFinished)[0].folder, one.told(AnalysisFinished)[0].stopped) == (figures["finding"], "")

    again = bench(tmp_path)
    assert {**demo(again.workspace, trials=30), "seconds": 0} == {**figures, "seconds": 0}
    assert again.machine.executed == []


def test_a_unit_without_a_fault_has_no_finding(tmp_path: Path) -> None:
    figures = demo(bench(tmp_path, fails=never_hangs).workspace, trials=6)
    assert figures["findings"] == []
    assert "finding" not in figures


def test_a_step_that_can_say_nothing_ends_the_chain_and_the_report_is_written(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_fields(one)
    done = analyze(one.workspace, one.folder)
    assert "no field of the minimal log is relevant" in done.stopped
    assert done.report.is_file()
    (stopped,) = one.told(StepStopped)
    assert (stopped.step, stopped.text, stopped.folder) == ("rules", done.stopped, str(one.folder))
    assert view.load(one.folder).next_step == "rules"
    page = done.report.read_text()
    assert "The step `rules` ended early: " in page
    assert "no field of the minimal log is relevant" in page
    assert "has not been run" not in page


def test_what_cannot_be_intercepted_is_told_before_anything_is_run(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM.replace('segment = "shop"', 'segment = "inside"'))
    options = ["--system", str(one.workspace.context.file.path), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(make_app("analyze"), ["analyze", *options])
    assert isinstance(done.exception, ConfigError)
    assert "share segment 'inside' with the system" in str(done.exception)


def test_without_external_topics_the_chain_ends_with_the_rule(tmp_path: Path) -> None:
    one = bench(tmp_path, ALONE)
    failing(one, 41)
    assert analyze(one.workspace, one.folder).stopped == ""
    assert [event.step for event in one.told(StepFinished)] == ["minimize", "relevance", "rules"]


def test_what_fails_since_messages_are_missing_is_analysed_too(tmp_path: Path) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        modified = 41 in numbers and said(messages[numbers.index(41)]) != said(command("step", 3.0, 41))
        return 1 if modified or 0 not in numbers else None

    one = bench(tmp_path, ALONE, fails=fails)
    failing(one, 41)
    nominal_passes(one)
    done = analyze_all(one.workspace, [one.folder])
    assert [each.folder for each in done] == [one.folder, other_cause(one.folder)]
    assert all(each.report.is_file() for each in done)
    assert MinimalRecord.exists(done[1].folder)


def test_steps_get_their_options(tmp_path: Path) -> None:
    one = bench(tmp_path, ALONE)
    failing(one, 41)
    got = []

    def count(step, folder: Path, *, most: int) -> CountRecord:
        got.append(most)
        return CountRecord(messages=3)

    further = ChainStep("count", "messages", "Count.", CountRecord, count)
    analyze(one.workspace, one.folder, further=[further], options={"count": {"most": 7}, "other": {"x": 1}})
    assert got == [7]


def test_a_step_that_cannot_go_on_with_one_finding_leaves_the_others_alone(tmp_path: Path) -> None:
    one = bench(tmp_path, ALONE)
    failing(one, 41)

    def refuse(step, folder: Path) -> CountRecord:
        raise PayloadError("nothing tells what the elements of an empty array are", where="len(data)")

    further = ChainStep("count", "messages", "Count.", CountRecord, refuse)
    (done,) = analyze_all(one.workspace, [one.folder], further=[further])
    assert "nothing tells what the elements" in done.stopped
    assert done.report.is_file()


def test_findings_of_malformed_payloads_are_not_taken_through_the_chain(tmp_path: Path) -> None:
    one = bench(tmp_path, ALONE)
    failing(one, 41)
    FindingRecord.load(one.folder).model_copy(update={"malformed": True}).save(one.folder)
    assert analyze_all(one.workspace, [one.folder]) == []
    assert analyze(one.workspace, one.folder).stopped == ""


class CountRecord(Artefact):
    """How many messages the failing log holds."""

    FILE = "count.json"
    messages: int

    @property
    def summary(self) -> str:
        return f"{self.messages} messages"


def test_further_steps_come_last(tmp_path: Path) -> None:
    one = bench(tmp_path, ALONE)
    failing(one, 41)

    def count(step, folder: Path) -> CountRecord:
        return CountRecord(messages=3)

    further = ChainStep("count", "messages", "Count.", CountRecord, count)
    analyze(one.workspace, one.folder, further=[further])
    assert [event.step for event in one.told(StepFinished)][-1] == "count"
    assert CountRecord.load(one.folder).messages == 3
    assert CountRecord.load(one.folder).seconds >= 0


def test_a_finished_step_whose_file_is_damaged_is_not_repeated_silently(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_finding(one, [], {})
    (one.folder / "minimal.json").write_text("{")
    with pytest.raises(ConfigError, match="run `riot minimize` again"):
        analyze(one.workspace, one.folder)


def test_examples_are_found_by_name() -> None:
    assert find_example("rover").is_file()
    with pytest.raises(ConfigError, match="the example 'rovr' is not installed"):
        find_example("rovr")
