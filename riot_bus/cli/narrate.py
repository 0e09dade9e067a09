"""Telling people how the work goes: a line per finished step, and a progress bar on terminals only."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

__all__ = ["ConsoleNarrator"]


class ConsoleNarrator:
    """A `Narrator` on stderr (or wherever diagnostics go); a context manager."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._begun: dict[str, float] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def begin(self, step: str) -> None:
        """Show that a step starts."""
        self._stop()
        self._begun[step] = time.monotonic()
        if self._console.is_terminal:
            from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (
                SpinnerColumn(),
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed} {task.fields[note]}"),
                TimeElapsedColumn(),
            )
            self._bar = Progress(*columns, console=self._console, transient=True)
            self._task = self._bar.add_task(step, total=None, note="")
            self._bar.start()

    def progress(self, done: int, total: int | None, note: str) -> None:
        """Move the bar."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=total, note=note)

    def end(self, step: str, text: str) -> None:
        """Say in a line what a step has come to."""
        self._stop()
        begun = self._begun.get(step)
        took = f" [{time.monotonic() - begun:.1f} s]" if begun is not None else ""
        self._console.print(f"{step:>12}  {text}{took}", markup=False, highlight=False, soft_wrap=True)

    def _stop(self) -> None:
        if self._bar is not None:
            self._bar.stop()
        self._bar = self._task = None
