from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import pytest

from riot_bus.events import StepFinished, StepProgress
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase
from riot_bus_fleet import over_fleet
from riot_bus_fleet.logs.entry import LogEntry
from riot_bus_fleet.over_fleet import FleetOptions, LogAnswer, _Answers, exit_code, run_over
from riot_bus_fleet.testcases import CaseTemplate
from tests.unit.chain.machine import HANG, OTHER, bench, command


@pytest.mark.parametrize(
    ("answers", "code"),
    [
        ([], 0),
        (["fixed", "fixed"], 0),
        (["fixed", "error"], 4),
        (["error", "failed", "fixed"], 1),
    ],
)
def test_exit_codes(answers: list[Literal["fixed", "failed", "error"]], code: int) -> None:
    assert exit_code([LogAnswer("/a.mcap", each) for each in answers]) == code


def test_answers_outlive_a_kill_in_the_middle_of_a_line(tmp_path: Path) -> None:
    path = tmp_path / "fleet" / "answers.jsonl"
    answers = _Answers(path)
    one, two = LogAnswer("/1.mcap", "fixed", trials=1), LogAnswer("/2.mcap", "failed", "why", 1, 1, 3, 9)
    key = answers.key(["fingerprint", 1, None])
    answers.put(key, one)
    answers.put("other", two)
    path.write_bytes(path.read_bytes()[:-5])
    again = _Answers(path)
    assert (again.get(key), again.get("other"), again.get("none")) == (one, None, None)
    again.put("other", two)
    assert _Answers(path).get("other") == two
    with path.open("a") as stream:
        stream.write('{"key": "odd", "answer": {"place": 1}}\n[]\n"x"\n')
    assert _Answers(path).get("odd") is None


HURT = CaseTemplate((Injection("command", "speed", -1.0, first=3, last=5),), HANG.signature)


def logged(folder: Path, name: str, rows: list[Message], **more: Any) -> LogEntry:
    path = folder / f"{name}.mcap"
    with LogWriter(path, LogSettings(**more)) as writer:
        for row in rows:
            writer.write(row)
    return LogEntry(place=str(path), size=path.stat().st_size, stamp="1", robot="r")


def steps(count: int = 10, mode: str = "step") -> list[Message]:
    return [command(mode, 3.0, number) for number in range(count)]


def test_each_log_gets_an_answer_and_keeps_it(tmp_path: Path) -> None:
    one = bench(tmp_path)
    one.workspace.jobs = 2
    text = tmp_path / "text.mcap"
    text.write_text("no log")
    logs = [
        logged(tmp_path, "step", steps()),
        logged(tmp_path, "hold", steps(mode="hold")),
        logged(tmp_path, "short", steps(2)),
        logged(tmp_path, "other", [steps()[0].with_(key="elsewhere")]),
        LogEntry(place=str(text), size=6, stamp="1", robot="r"),
        LogEntry(place=str(tmp_path / "gone.mcap"), size=6, stamp="1", robot="r"),
    ]
    answers = run_over(one.workspace, HURT, "drive", logs, FleetOptions(times=2))
    assert [each.answer for each in answers] == ["failed", "fixed", "error", "error", "error", "error"]
    failed, fixed, short, other, *_ = answers
    assert (failed.failed, failed.trials, failed.injected, failed.messages, failed.detail) == (
        2,
        2,
        3,
        10,
        "still busy",
    )
    assert (fixed.failed, fixed.injected) == (0, 3)
    assert "changes nothing in it" in short.detail
    assert "holds nothing on the inputs of 'drive' (command)" in other.detail
    finished = one.told(StepFinished)[-1]
    assert finished.step == "fleet run"
    assert finished.text.startswith("6 logs, 6 of them now, in ")
    assert len(one.told(StepProgress)) == 6

    count = len(one.machine.executed)
    assert run_over(one.workspace, HURT, "drive", logs[:2], FleetOptions(times=2)) == answers[:2]
    assert len(one.machine.executed) == count == 4
    run_over(one.workspace, HURT, "drive", logs[:2], FleetOptions(times=2, again=True))
    assert len(one.machine.executed) == 8


def test_a_noisy_unit_fails_in_some_trials_or_in_another_way(tmp_path: Path) -> None:
    log = logged(tmp_path, "step", steps())
    one = bench(tmp_path, wrong=lambda case: case.seed == 1)
    (answer,) = run_over(one.workspace, HURT, "drive", [log], FleetOptions(times=3))
    assert (answer.answer, answer.failed, answer.trials) == ("failed", 2, 3)
    two = bench(tmp_path, other=lambda case: case.seed == 1)
    (answer,) = run_over(two.workspace, HURT, "drive", [log], FleetOptions(times=2, again=True))
    assert (answer.answer, answer.failed) == ("failed", 1)
    assert answer.detail == f"still busy; fails in another way: {OTHER.signature}"


def test_a_trial_that_cannot_be_carried_out_is_tried_again(tmp_path: Path) -> None:
    log = logged(tmp_path, "step", steps())
    answers = iter([True, True, False, True, True, True])
    one = bench(tmp_path, broken=lambda case: next(answers))
    assert [each.answer for each in run_over(one.workspace, HURT, "drive", [log], FleetOptions())] == ["failed"]
    (answer,) = run_over(one.workspace, HURT, "drive", [log], FleetOptions(again=True))
    assert (answer.answer, answer.detail) == ("error", "no port")
    stored = (one.workspace.out / "fleet" / "answers.jsonl").read_text()
    assert '"error"' not in stored


def test_what_nothing_can_tell_is_not_called_fixed(tmp_path: Path) -> None:
    silent = CaseTemplate(HURT.injections, "silent of drive: nothing on state")
    log = logged(tmp_path, "one", [command("hold", 3.0, number) for number in range(9)])
    one = bench(tmp_path)
    (answer,) = run_over(one.workspace, silent, "drive", [log], FleetOptions())
    assert answer.answer == "error"
    assert answer.detail.startswith("nothing here shows whether it fails: ")


def test_a_part_of_a_log_is_played(tmp_path: Path) -> None:
    log = logged(tmp_path, "step", steps(40))
    one = bench(tmp_path)
    (answer,) = run_over(one.workspace, HURT, "drive", [log], FleetOptions(start=0.5, duration=0.5))
    assert (answer.messages, answer.injected) == (10, 3)
    (answer,) = run_over(one.workspace, HURT, "drive", [log], FleetOptions(start=1.0))
    assert answer.messages == 20
    empty = logged(tmp_path, "empty", [])
    (answer,) = run_over(one.workspace, HURT, "drive", [empty], FleetOptions(duration=1.0))
    assert answer.answer == "error"


def test_a_damaged_log_is_tried_as_far_as_it_goes(tmp_path: Path) -> None:
    log = logged(tmp_path, "step", steps(400), chunk_bytes=2000)
    data = Path(log.place).read_bytes()
    Path(log.place).write_bytes(data[: len(data) // 2])
    (answer,) = run_over(bench(tmp_path).workspace, HURT, "drive", [log], FleetOptions())
    assert answer.answer == "failed"
    assert "; the log is damaged: " in answer.detail


def test_a_huge_log_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(over_fleet, "_LARGEST", 300)
    log = logged(tmp_path, "step", steps(40))
    (answer,) = run_over(bench(tmp_path).workspace, HURT, "drive", [log], FleetOptions())
    assert "it holds more than 0 MiB for 'drive'" in answer.detail


def test_a_failure_of_ours_is_an_answer_too(tmp_path: Path) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        raise ZeroDivisionError

    one = bench(tmp_path, fails=fails)
    (answer,) = run_over(one.workspace, HURT, "drive", [logged(tmp_path, "step", steps())], FleetOptions())
    assert (answer.answer, answer.detail) == ("error", "riot_bus itself failed: ZeroDivisionError()")


def test_an_interruption_stops_what_has_not_begun(tmp_path: Path) -> None:
    def wrong(case: TestCase) -> bool:
        raise KeyboardInterrupt

    logs = [logged(tmp_path, str(number), steps(10 + number)) for number in range(20)]
    one = bench(tmp_path, wrong=wrong)
    one.workspace.jobs = 1
    with pytest.raises(KeyboardInterrupt):
        run_over(one.workspace, HURT, "drive", logs, FleetOptions())
    assert not (one.workspace.out / "fleet" / "answers.jsonl").exists()
