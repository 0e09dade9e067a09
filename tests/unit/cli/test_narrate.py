from __future__ import annotations

import io
from datetime import datetime, timedelta

from rich.console import Console

from riot_bus.cli.narrate import ConsoleNarrator
from riot_bus.events import RunEvent, StepFinished, StepProgress, StepStarted, StepStopped, TimeLeft, TrialFinished

EVENTS: list[RunEvent] = [
    StepStarted("minimize"),
    TrialFinished("minimize", "fail", "crash", "", 0.1),
    StepProgress("minimize", 3, None, "halves"),
    StepFinished("minimize", "9 :x: -> [1]", 0.26),
    StepProgress("rules", 3, 10, "late"),
    StepStarted("rules"),
    StepStopped("rules", "no rule", "folder"),
]


def told(*, terminal: bool) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=40, no_color=True)
    with ConsoleNarrator(console) as narrator:
        for event in EVENTS:
            narrator(event)
    return stream.getvalue()


def test_a_line_for_each_finished_step() -> None:
    assert told(terminal=False) == "    minimize  9 :x: -> [1] [0.3 s]\n       rules  no rule\n"


def test_terminals_get_a_bar_meanwhile() -> None:
    text = told(terminal=True)
    assert "3 halves" in text
    assert "    minimize  9 :x: -> [1] [0.3 s]\n" in text


def test_without_a_terminal_a_line_each_ten_seconds_tells_how_fast_it_goes() -> None:
    stream, times = io.StringIO(), iter([0.0, 100.0, 104.0, 110.0, 111.0, 120.0, 131.0])
    with ConsoleNarrator(Console(file=stream, width=40), now=lambda: next(times)) as narrator:
        narrator(StepStarted("test"))
        for done, total in ((10, 100), (20, 100), (30, 100), (30, 100), (41, None)):
            narrator(StepProgress("test", done, total, "1 failing"))
    assert stream.getvalue().splitlines() == [
        "        test  20 of 100, 1 failing; 2/s, about 40 s to go",
        "        test  30 of 100, 1 failing; 1/s, about 70 s to go",
        "        test  41, 1 failing; 1/s",
    ]


def test_a_time_that_was_given_ends_a_step_before_its_rate_does() -> None:
    stream, times = io.StringIO(), iter([0.0, 0.0, 10.0, 20.0, 30.0, 40.0])
    with ConsoleNarrator(Console(file=stream, width=40), now=lambda: next(times)) as narrator:
        narrator(StepStarted("test"))
        for done, total, left in ((10, 100, 50.0), (20, 40, 900.0), (20, None, 30.0), (20, None, 0.0)):
            narrator(StepProgress("test", done, total, "1 failing", left))
    assert stream.getvalue().splitlines() == [
        "        test  10 of 100, 1 failing; 1/s, about 50 s to go",
        "        test  20 of 40, 1 failing; 1/s, about 20 s to go",
        "        test  20, 1 failing; 0/s, about 30 s to go",
        "        test  20, 1 failing; 0/s",
    ]


def test_terminals_are_told_how_fast_it_goes_too() -> None:
    stream, times = io.StringIO(), iter([0.0, 0.0, 10.0, 12.0])
    console = Console(file=stream, force_terminal=True, width=100, no_color=True)
    with ConsoleNarrator(console, now=lambda: next(times)) as narrator:
        narrator(StepStarted("test"))
        narrator(StepProgress("test", 20, 100, "1 failing"))
        narrator(StepProgress("test", 30, 100, "1 failing"))
    assert "30 1 failing; 2/s, about 35 s to go" in stream.getvalue()


def test_what_is_left_of_a_given_time_and_until_when() -> None:
    stream = io.StringIO()
    with ConsoleNarrator(Console(file=stream, width=80)) as narrator:
        before = datetime.now().astimezone()
        narrator(TimeLeft(90.0, 1800.0))
        narrator(TimeLeft(9.4, 30.0))
        after = datetime.now().astimezone()
    first, second = stream.getvalue().splitlines()
    told = {f"{each + timedelta(seconds=90):%H:%M:%S}" for each in (before, after)}
    assert first.rpartition(" ")[0] == "        time  1.5 min of 30.0 min left, until"
    assert first.rpartition(" ")[2] in told
    assert second.startswith("        time  9 s of 30 s left, until ")
