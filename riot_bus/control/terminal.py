"""The terminal of a run in the foreground: keys that control it, and a progress line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

__all__ = ["Console", "Foreground"]

_LOOK_S = 0.2  # the longest delay of a key or signal; five looks a second cost little


class Console(Protocol):
    """A terminal."""

    def keys(self, timeout: float) -> list[str]:
        """Return the keys that were pressed, after waiting at most `timeout` seconds."""
        ...

    def progress(self, line: str) -> None:
        """Show a line in place of the previous one; an empty line ends the display."""
        ...


class Foreground:
    """A run in the foreground.

    Args:
        console: Shows progress and takes keys; None if there is no terminal.
        warn: Prints a line of diagnostics.
    """

    def __init__(self, console: AbstractContextManager[Console] | None, warn: Callable[[str], None]) -> None:
        self._console, self._warn = console, warn
        self._shown: Console | None = None

    def tell(self, line: str) -> None:
        """Print a line of diagnostics; a progress line is ended first."""
        if self._shown is not None:
            self._shown.progress("")
        self._warn(line)

    def attend(
        self, wait: Callable[[float], bool], *, keys: str, press: Callable[[str], None], line: Callable[[], str]
    ) -> None:
        """Wait for the end of the run; with a terminal, take keys and show progress.

        Args:
            wait: Waits for the end for at most the given seconds; returns whether it has come.
            keys: Explanation of the keys, printed at the start.
            press: Called with each key pressed.
            line: Returns the progress line to show.
        """
        if self._console is None:
            while not wait(_LOOK_S):
                pass  # not one endless wait: a signal just before its beginning would not end it
            return
        with self._console as console:
            self._warn(keys)
            self._shown = console
            while not wait(0):
                for key in console.keys(_LOOK_S):
                    press(key)
                console.progress(line())
            console.progress("")
