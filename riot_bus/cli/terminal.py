"""Single keys from a terminal, and a line of progress on it; the terminal is always left as it was."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import tty
from functools import partial
from typing import Any, Self

import typer

from riot_bus.cli.options import OutputFormat
from riot_bus.control.terminal import Foreground

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_KEY = re.compile(r"\x1b[\[O]([0-9;]*)([@-~])|.", re.DOTALL)
_UNFINISHED = re.compile(r"\x1b([\[O][0-9;]*)?\Z")
_MOST = 64  # a key sends a few bytes; more comes only from pasted text, which takes several reads


def foreground_of(form: OutputFormat, *, keys: bool = False) -> Foreground:
    """Return the frame of a command's run: results on stdout, diagnostics on stderr, keys from a terminal."""
    console = Terminal() if keys and Terminal.present() else None
    return Foreground(typer.echo, partial(typer.echo, err=True), console=console, as_json=form is OutputFormat.JSON)


class Terminal:
    """Reads keys as they are pressed; a context manager.

    Ctrl-C and Ctrl-Z work as usual. While in the background, no key is read and nothing is shown.
    """

    def __init__(self) -> None:
        self._input = sys.stdin.fileno()
        self._former: list[Any] = []
        self._width = 0
        self._open = True
        self._rest = ""

    @staticmethod
    def present() -> bool:
        """Return whether stdin and stderr are a terminal."""
        both = (sys.stdin, sys.stderr)
        return all(each is not None and not each.closed and each.isatty() for each in both)

    def __enter__(self) -> Self:
        self._former = termios.tcgetattr(self._input)
        return self

    def __exit__(self, *error: object) -> None:
        self.progress("")
        if self._foreground():
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._former)

    def keys(self, timeout: float) -> list[str]:
        """Return the keys that were pressed; wait for one at most `timeout` seconds.

        Arrows are called `up`, `down`, `left` and `right`.
        """
        reading = self._open and self._foreground()
        if reading and termios.tcgetattr(self._input)[3] & termios.ICANON:  # at first, and after a Ctrl-Z
            tty.setcbreak(self._input, termios.TCSADRAIN)
        ready, _, _ = select.select([self._input] if reading else [], [], [], timeout)
        if not ready:
            return []
        try:
            data = os.read(self._input, _MOST)
        except OSError:  # the terminal has gone
            data = b""
        self._open = bool(data)
        found, self._rest = split_keys(self._rest + data.decode("ascii", "ignore"))
        return found

    def progress(self, line: str) -> None:
        """Show a line in place of the one before; an empty line removes it."""
        if not self._foreground() or (not line and not self._width):
            return
        columns = os.get_terminal_size(sys.stderr.fileno()).columns or 80
        line = line[: columns - 1]
        sys.stderr.write(f"\r{line.ljust(self._width)}" if line else f"\r{' ' * self._width}\r")
        sys.stderr.flush()
        self._width = len(line)

    def _foreground(self) -> bool:
        try:
            return os.tcgetpgrp(self._input) == os.getpgrp()
        except OSError:
            return False


def split_keys(text: str) -> tuple[list[str], str]:
    r"""Return the keys that a terminal has sent, and the beginning of an unfinished one.

    Arrows have names; other keys that are sent as several characters are left out.

    Example:
        >>> split_keys("a\x1b[A\x1b[5~\x1b[")
        (['a', 'up'], '\x1b[')
    """
    unfinished = _UNFINISHED.search(text)
    rest = unfinished.group() if unfinished is not None else ""
    found: list[str] = []
    for match in _KEY.finditer(text, 0, len(text) - len(rest)):
        name = match.group() if match.group(2) is None else _ARROWS.get(match.group(2))
        if name is not None:
            found.append(name)
    return found, rest[-_MOST:]
