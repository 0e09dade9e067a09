"""The terminal of what runs in the foreground: keys that steer it, and a line that shows how far it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

__all__ = ["Console", "Foreground"]

_LOOK_S = 0.2


class Console(Protocol):
    """A terminal."""

    def keys(self, timeout: float) -> list[str]:
        """Return what was pressed; waits for it at most so many seconds."""
        ...

    def progress(self, line: str) -> None:
        """Show a line in place of the one before; the empty line ends it."""
        ...


class Foreground:
    """What runs in the foreground.

    Args:
        console: Shows progress and takes keys; None if there is no terminal.
        warn: Prints a line of diagnostics.
    """

    def __init__(self, console: AbstractContextManager[Console] | None, warn: Callable[[str], None]) -> None:
        self._console, self._warn = console, warn
        self._shown: Console | None = None

    def tell(self, line: str) -> None:
        """Print a line of diagnostics, not behind the progress."""
        if self._shown is not None:
            self._shown.progress("")
        self._warn(line)

    def attend(
        self, wait: Callable[[float], bool], *, keys: str, press: Callable[[str], None], line: Callable[[], str]
    ) -> None:
        """Wait for the end.

        Args:
            wait: Waits at most so many seconds; returns whether it has come.
            keys: What keys mean, for people.
            press: Called with each key.
            line: Returns the progress to show.
        """
        if self._console is None:
            while not wait(_LOOK_S):
                pass  # a signal that comes just before an endless wait begins does not end it
            return
        with self._console as console:
            self._warn(keys)
            self._shown = console
            while not wait(0):
                for key in console.keys(_LOOK_S):
                    press(key)
                console.progress(line())
            console.progress("")
