from __future__ import annotations

import io

from rich.console import Console

from riot_bus.cli.narrate import ConsoleNarrator
from riot_bus.events import RunEvent, StepFinished, StepProgress, StepStarted, StepStopped, TrialFinished

EVENTS: list[RunEvent] = [
    StepStarted("minimize"),
    TrialFinished("minimize", "fail", "crash", "", 0.1),
    StepProgress("minimize", 3, None, "halves"),
    StepFinished("minimize", "9 messages -> [1]", 0.26),
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
    assert told(terminal=False) == "    minimize  9 messages -> [1] [0.3 s]\n       rules  no rule\n"


def test_terminals_get_a_bar_meanwhile() -> None:
    text = told(terminal=True)
    assert "3 halves" in text
    assert "    minimize  9 messages -> [1] [0.3 s]\n" in text
