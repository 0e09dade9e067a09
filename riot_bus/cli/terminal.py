"""Single keys from a terminal, and a line of progress on it; the terminal is always left as it was."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from typing import Any, Self

__all__ = ["Terminal"]

_LOCAL = 3  # of tcgetattr: local modes
_COLUMNS = 80  # of a terminal that does not tell
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}


class Terminal:
    """Reads keys as they are pressed; a context manager.

    Ctrl-C and Ctrl-Z work as ever. While in the background, no key is read and nothing is shown.
    """

    def __init__(self) -> None:
        self._input = sys.stdin.fileno()
        self._former: list[Any] = []
        self._width = 0
        self._open = True

    @staticmethod
    def present() -> bool:
        """Return whether stdin and stderr are a terminal."""
        return sys.stdin.isatty() and sys.stderr.isatty()

    def __enter__(self) -> Self:
        self._former = termios.tcgetattr(self._input)
        return self

    def __exit__(self, *error: object) -> None:
        self.progress("")
        if self._foreground():
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._former)

    def keys(self, timeout: float) -> list[str]:
        """Return the keys that were pressed; waits for one at most so many seconds.

        Arrows are called `up`, `down`, `left` and `right`.
        """
        reading = self._open and self._foreground()
        if reading and termios.tcgetattr(self._input)[_LOCAL] & termios.ICANON:  # at first, and after a Ctrl-Z
            tty.setcbreak(self._input, termios.TCSADRAIN)
        ready, _, _ = select.select([self._input] if reading else [], [], [], timeout)
        if not ready:
            return []
        text = os.read(self._input, 64).decode("ascii", "ignore")
        self._open = bool(text)
        found: list[str] = []
        while text:
            if text[:2] in ("\x1b[", "\x1bO") and text[2:3] in _ARROWS:
                found.append(_ARROWS[text[2]])
                text = text[3:]
            else:
                found.append(text[0])
                text = text[1:]
        return found

    def progress(self, line: str) -> None:
        """Show a line in place of the one before; the empty line takes it away."""
        if not self._foreground() or (not line and not self._width):
            return
        columns = os.get_terminal_size(sys.stderr.fileno()).columns or _COLUMNS
        line = line[: columns - 1]
        sys.stderr.write(f"\r{line.ljust(self._width)}" if line else f"\r{' ' * self._width}\r")
        sys.stderr.flush()
        self._width = len(line)

    def _foreground(self) -> bool:
        try:
            return os.tcgetpgrp(self._input) == os.getpgrp()
        except OSError:
            return False
