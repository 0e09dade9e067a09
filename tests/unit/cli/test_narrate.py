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


def narrated(*events: tuple[float, RunEvent], width: int = 40) -> list[str]:
    """Return the lines about events that come at these times, in seconds."""
    stream, clock = io.StringIO(), [0.0]
    with ConsoleNarrator(Console(file=stream, width=width), now=lambda: clock[0]) as narrator:
        for clock[0], event in events:
            narrator(event)
    return stream.getvalue().splitlines()


def test_without_a_terminal_a_line_each_ten_seconds_tells_how_fast_it_goes() -> None:
    counts = (
        (104.0, 10, 100),
        (110.0, 15, 100),
        (114.0, 30, 100),
        (120.0, 40, 100),
        (124.0, 40, 100),
        (138.0, 44, None),
    )
    progress = ((at, StepProgress("test", done, total, "1 failing")) for at, done, total in counts)
    assert narrated((0.0, StepStarted("test")), *progress) == [
        "        test  30 of 100, 1 failing; 2/s, about 35 s for the rest",
        "        test  40 of 100, 1 failing; 1/s, about 60 s for the rest",
        "        test  44, 1 failing; 0.58/s",
    ]


def test_the_rate_does_not_swing_with_what_takes_long_once() -> None:
    counts = [(0.0, 0), (10.0, 10), (20.0, 20), (30.0, 20), (40.0, 40)]  # a failure was repeated for 10 s
    events = [(at, StepProgress("test", done, 100, "")) for at, done in counts]
    ends = [float(line.split("about ")[1].split(" s")[0]) for line in narrated((0.0, StepStarted("test")), *events)]
    assert ends == [90, 80, 160, 60]


def test_a_count_that_begins_again_has_a_rate_of_its_own() -> None:
    counts = [(0.0, 1, 8), (10.0, 6, 8), (20.0, 1, 24), (30.0, 2, 24)]
    lines = narrated(*((at, StepProgress("permeability", done, total, "")) for at, done, total in counts))
    assert [line.split("about ")[-1] for line in lines] == ["4 s for the rest", "220 s for the rest"]


def test_a_time_that_was_given_ends_a_step_before_its_rate_does() -> None:
    counts = (
        (0.0, 0, 100, 60.0), (10.0, 10, 100, 50.0), (20.0, 20, 40, 900.0), (30.0, 20, None, 30.0), (40.0, 20, None, 0.0)
    )  # fmt: skip
    events = ((at, StepProgress("test", done, total, "1 failing", left)) for at, done, total, left in counts)
    assert narrated((0.0, StepStarted("test")), *events) == [
        "        test  10 of 100, 1 failing; 1/s, about 50 s to go",
        "        test  20 of 40, 1 failing; 1/s, about 20 s for the rest",
        "        test  20, 1 failing; 0.5/s, about 30 s to go",
        "        test  20, 1 failing; 0/s",
    ]


def test_the_time_for_all_steps_is_told_with_each_line() -> None:
    lines = narrated(
        (0.0, TimeLeft(180.0, 180.0)),
        (0.0, StepStarted("rules")),
        (60.0, StepProgress("rules", 1, 10, "late")),
        (80.0, StepProgress("rules", 3, 10, "late")),
        (190.0, StepProgress("rules", 9, 10, "late")),
    )
    assert lines[1:] == [
        "       rules  3 of 10, late; 0.1/s, about 70 s for the rest; 1.7 min of 3.0 min left",
        "       rules  9 of 10, late; 0.055/s, about 18 s for the rest; 0 s of 3.0 min left",
    ]


def test_terminals_are_told_how_fast_it_goes_too() -> None:
    stream, times = io.StringIO(), iter([0.0, 10.0])
    console = Console(file=stream, force_terminal=True, width=100, no_color=True)
    with ConsoleNarrator(console, now=lambda: next(times)) as narrator:
        narrator(StepStarted("test"))
        narrator(StepProgress("test", 20, 100, "1 failing"))
        narrator(StepProgress("test", 30, 100, "1 failing"))
    assert "30 1 failing; 1/s, about 70 s for the rest" in stream.getvalue()


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
