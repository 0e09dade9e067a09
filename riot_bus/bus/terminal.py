"""The terminal of what runs in the foreground: keys that steer it, and a line that shows how far it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Console", "attend"]

_LOOK_S = 0.2


class Console(Protocol):
    """A terminal."""

    def keys(self, timeout: float) -> list[str]:
        """Return what was pressed; waits for it at most so many seconds."""
        ...

    def progress(self, line: str) -> None:
        """Show a line in place of the one before; the empty line ends it."""
        ...


def attend(
    wait: Callable[[float], bool], console: Console | None, *, press: Callable[[str], None], line: Callable[[], str]
) -> None:
    """Wait for the end of something.

    Args:
        wait: Waits at most so many seconds; returns whether it has ended.
        console: Shows progress and takes keys meanwhile; None if there is no terminal.
        press: Called with each key.
        line: Returns the line to show.
    """
    if console is None:
        while not wait(_LOOK_S):
            pass  # a signal that comes just before an endless wait begins does not end it
        return
    while not wait(0):
        for key in console.keys(_LOOK_S):
            press(key)
        console.progress(line())
    console.progress("")
