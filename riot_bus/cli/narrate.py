"""Progress of the work: for people as lines and a progress bar, for programs as lines of JSON."""

from __future__ import annotations

import json
import sys
import time
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Self

import typer

from riot_bus.events import StepFinished, StepProgress, StepStarted, StepStopped, TimeLeft
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rich.console import Console
    from rich.progress import Progress, TaskID

    from riot_bus.events import RunEvent

_EVERY = 10.0
"""Seconds between lines of progress if there is no terminal."""


def write_line(event: RunEvent) -> None:
    """Write an event to stdout, as JSON in a line of its own."""
    typer.echo(json.dumps(event.as_json()))


@contextmanager
def bar(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar on stderr if that is a terminal; yield a function of the parts done and of all, or None."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(title)
        yield lambda done, total: shown.update(task, completed=done, total=max(total, 1))


class ConsoleNarrator:
    """A listener that shows events on stderr (or wherever diagnostics go); a context manager."""

    def __init__(self, console: Console, *, now: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._now = now
        self._measured: list[tuple[float, int]] = []
        self._rate: float | None = None
        self._end: tuple[float, float] | None = None
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def __call__(self, event: RunEvent) -> None:
        """Show a bar while a step runs (without a terminal, a line every ten seconds), and a line at its end."""
        match event:
            case StepStarted():
                self._stop()
                self._measured, self._rate = [], None
                self._start(event.step)
            case StepProgress() if self._bar is not None and self._task is not None:
                self._measure(event)
                self._bar.update(self._task, completed=event.done, total=event.total, note=self._pace(event))
            case StepProgress() if not self._console.is_terminal and self._measure(event):
                far = f"{event.done} of {event.total}" if event.total else str(event.done)
                self._say(event.step, far + (", " if event.note else "") + self._pace(event))
            case StepFinished():
                first, *more = event.text.split("\n")
                self._say(event.step, "\n".join([f"{first} [{event.seconds:.1f} s]", *more]))
            case StepStopped():
                self._say(event.step, event.text)
            case TimeLeft():
                self._end = self._now() + event.seconds, event.total
                at = datetime.now().astimezone() + timedelta(seconds=event.seconds)
                left, total = (_minutes(each) for each in (event.seconds, event.total))
                self._say("time", f"{left} of {total} left, until {at:%H:%M:%S}")

    def interrupted(self, out: Path) -> None:
        """Say what the output folder keeps of interrupted work, and how to continue."""
        from riot_bus.campaign.store import TrialStore, stored_trials
        from riot_bus.findings.records import FindingRecord

        self._stop()
        trials = len(stored_trials(out / "trials" / TrialStore.NAME))
        findings = len(FindingRecord.folders(out / "findings"))
        text = (
            f"riot: interrupted; kept in {out}: {counted(trials, 'finished trial')}, {counted(findings, 'finding')}. "
        )
        text += "Trials under way are not counted. Run the same command again to go on."
        self._console.print(escape_control_chars(text), markup=False, emoji=False, highlight=False, soft_wrap=True)

    def _start(self, step: str) -> None:
        if self._console.is_terminal:
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (
                SpinnerColumn(),
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TextColumn("{task.completed} {task.fields[note]}", markup=False),
                TimeElapsedColumn(),
            )
            self._bar = Progress(*columns, console=self._console, transient=True)
            self._task = self._bar.add_task(step, total=None, note="")
            self._bar.start()

    def _measure(self, event: StepProgress) -> bool:
        """Note how far a step is; return whether its rate was measured again, which is every ten seconds.

        The first result is the beginning, so starting processes does not count as slow. The rate is that of the later
        half of the time since then: one of ten seconds alone would swing with each failure that is repeated.
        """
        now = self._now()
        if not self._measured or event.done < self._measured[-1][1]:  # or the step has restarted its count
            self._measured, self._rate = [(now, event.done)], None
            return False
        if now - self._measured[-1][0] < _EVERY:
            return False
        middle = (self._measured[0][0] + now) / 2
        then, done = max(each for each in self._measured if each[0] <= middle)
        self._measured.append((now, event.done))
        self._rate = (event.done - done) / (now - then)
        return True

    def _pace(self, event: StepProgress) -> str:
        """Return the current activity, its rate, the time for the rest of it or until an earlier end, and for all."""
        ends = [] if event.left is None else [(event.left, "to go")]
        if event.total and self._rate:
            ends.append(((event.total - event.done) / self._rate, "for the rest"))
        text = event.note if self._rate is None else f"{event.note}; {self._rate:.2g}/s"
        seconds, what = min(ends, default=(0.0, ""))
        if seconds >= 1:
            text += f", about {seconds:.0f} s {what}"
        if self._end is not None:
            left, total = max(0.0, self._end[0] - self._now()), self._end[1]
            text += f"; {_minutes(left)} of {_minutes(total)} left"
        return text

    def _say(self, step: str, text: str) -> None:
        self._stop()
        line = f"{step:>12}  {escape_control_chars(text, keep=chr(10))}"
        self._console.print(line, markup=False, emoji=False, highlight=False, soft_wrap=True)

    def _stop(self) -> None:
        if self._bar is not None:
            self._bar.stop()
        self._bar = self._task = None


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"
