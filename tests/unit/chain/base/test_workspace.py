from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.base import workspace as room
from riot_bus.chain.base.workspace import Workspace, open_finding
from riot_bus.events import Listeners, StepFinished, StepStarted, TrialFinished
from riot_bus.findings.records import FindingRecord
from riot_bus.pool.runners import LocalRunners
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from tests.unit.chain.machine import COUNT, SYSTEM, always, bench, command, write_finding


def test_the_nominal_run_is_recorded_once_for_each_seed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    path = one.workspace.nominal_log()
    assert path == one.workspace.nominal_log() == tmp_path / "out" / "nominal.mcap"
    assert len(one.machine.executed) == 1
    assert list(path.parent.glob("*.partial*")) == []
    one.workspace.seed = 5
    one.workspace.nominal_log()
    assert [case.seed for case in one.machine.executed] == [0, 5]


def test_the_nominal_log_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    original = room.read_messages
    monkeypatch.setattr(room, "read_messages", lambda path, **more: read.append(path) or original(path, **more))
    one = bench(tmp_path)
    assert len(one.workspace.unit_log("drive")) == COUNT
    assert len(one.workspace.nominal_messages()) == 2 * COUNT
    assert len(read) == 1


def test_a_log_of_the_units_own_is_taken_instead(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM + 'log = "out/findings/hang-drive-1/failure.mcap"\n')
    write_finding(one, [command("step", 2.0)], {})
    assert len(one.workspace.unit_log("drive")) == 1
    assert one.machine.executed == []


def test_a_nominal_run_that_cannot_be_carried_out_is_tried_again(tmp_path: Path) -> None:
    answers = iter([True, True, False])
    one = bench(tmp_path, broken=lambda case: next(answers))
    assert one.workspace.nominal_log().is_file()
    assert len(one.machine.executed) == 3
    two = bench(tmp_path, broken=lambda case: True)
    two.workspace.seed = 2
    with pytest.raises(EnvironmentFaultError, match="the nominal run could not be carried out: no port"):
        two.workspace.nominal_log()


def test_a_system_that_fails_in_a_nominal_run_has_to_be_mended(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the system fails in 3 of 3 nominal runs: hang of drive"):
        bench(tmp_path, system_fails=always).workspace.nominal_log()


def test_a_nominal_run_that_fails_once_is_repeated_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    one = bench(tmp_path, system_fails=lambda made: None, system_wrong=lambda case: not case.again)
    assert one.workspace.nominal_log().is_file()
    assert "the system fails in 1 of 2 nominal runs: hang of drive" in caplog.text


def test_a_named_log_has_to_be_there(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM.replace('name = "machine"', 'name = "machine"\nnominal = "gone.mcap"'))
    with pytest.raises(ConfigError, match=r"the nominal log 'gone\.mcap' does not exist"):
        one.workspace.nominal_log()


def test_what_running_nodes_refuse_is_told_with_the_step(tmp_path: Path) -> None:
    told: list[object] = []
    one = bench(tmp_path)
    one.workspace.tell = Listeners([told.append])
    with one.workspace.step("activate") as step:
        for value in (11.0, 12.0):
            step.told(Outcome(Verdict.PASS, statistics={"refused": {"gain": f"/planner refused {value}: at most 10"}}))
        step.told(Outcome(Verdict.PASS))
        step.end("nothing was found")
    (ended,) = (each for each in told if isinstance(each, StepFinished))
    why = "param:gain was refused in 2 runs (last: /planner refused 12.0: at most 10)"
    assert ended.text == f"nothing was found; {why}"


def test_runners_are_given_back_in_the_end(tmp_path: Path) -> None:
    one = bench(tmp_path)
    with one.workspace:
        assert not one.machine.closed
    assert one.machine.closed


def test_by_default_runners_are_processes_that_nobody_has_started_yet(tmp_path: Path) -> None:
    (tmp_path / "riot.toml").write_text(SYSTEM)
    with Workspace(tmp_path / "riot.toml", tmp_path / "out", jobs=3) as workspace:
        assert isinstance(workspace.runners, LocalRunners)
        assert workspace.jobs == 3


def test_outcomes_depend_on_the_system_the_unit_and_what_is_observed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    pace = one.workspace.context.file.system.trial_run
    with one.workspace.step("some") as step:
        case = TestCase((command("step", 2.0),))
        step.unit_runner("drive").run([case])
        step.unit_runner("drive").run([case])
        assert len(one.machine.executed) == 1
        case = TestCase()
        step.system_runner(observe=["command:speed"], pace=pace).run([case])
        step.system_runner(observe=["panel"], pace=pace).run([case])
        assert len(one.machine.executed) == 3
        assert step.trials == 4
        step.end("done")
    assert [event.verdict for event in one.told(TrialFinished)] == ["pass"] * 4
    assert one.told(StepStarted) == [StepStarted("some")]
    (finished,) = one.told(StepFinished)
    assert (finished.text, finished.trials, finished.folder, finished.record) == ("done", 4, None, None)


def test_a_finding_is_opened_by_its_folder_or_as_the_only_one(tmp_path: Path) -> None:
    one = bench(tmp_path)
    with pytest.raises(ConfigError, match=r"no finding at[^`]*`riot test` first"):
        open_finding(one.workspace.out)
    write_finding(one, [command("step", 0.0)], {})
    folder, record = open_finding(one.folder)
    assert open_finding(one.workspace.out) == (folder, record) == (one.folder, FindingRecord.load(one.folder))
    with pytest.raises(ConfigError, match="hang-drive-1"):
        open_finding(one.folder.with_name("hang-drive-2"))
    (one.workspace.findings / "two").mkdir()
    record.save(one.workspace.findings / "two")
    with pytest.raises(ConfigError, match="2 findings in"):
        open_finding(one.workspace.out)
