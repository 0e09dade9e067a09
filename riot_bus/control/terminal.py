"""The frame of all runs in the foreground: results, diagnostics, progress, and keys that control the run."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Protocol

from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from contextlib import AbstractContextManager

    from riot_bus.pipeline.runner import Pipeline

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
    """The frame of a run in the foreground: its results, its diagnostics, and the wait for its end.

    Args:
        console: Terminal that shows progress and takes keys; None if there is no terminal.
        as_json: Whether results are printed as lines of JSON.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        warn: Callable[[str], None],
        *,
        console: AbstractContextManager[Console] | None = None,
        as_json: bool = False,
    ) -> None:
        self._say, self._warn, self._console, self._as_json = say, warn, console, as_json
        self._shown: Console | None = None

    def report(self, event: str, document: Mapping[str, Any], lines: Iterable[str]) -> None:
        """Print a result."""
        if self._as_json:
            lines = [json.dumps({"event": event, **document}, sort_keys=True)]
        for line in lines:
            self._say(line)

    def warn(self, line: str) -> None:
        """Print a line of diagnostics, without control characters; a progress line is ended first."""
        if self._shown is not None:
            self._shown.progress("")
        self._warn(escape_control_chars(line, keep="\n\t"))

    def warn_of_errors(self, pipeline: Pipeline | None) -> None:
        """Print which interceptors of a pipeline have raised exceptions, how often, and the first one of each."""
        for name, errors in pipeline.errors.items() if pipeline is not None else ():
            text = f"interceptor {name} raised {errors.count} times; the messages went on without it. First:"
            self.warn(f"{text}\n{errors.first}")

    def attend(
        self,
        wait: Callable[[float], bool],
        *,
        look: Callable[[], None] = lambda: None,
        keys: str = "",
        actions: Mapping[str, Callable[[], None]] | None = None,
        line: Callable[[], str] = str,
    ) -> None:
        """Wait for the end of the run; with a terminal, take keys and show progress.

        Args:
            wait: Function that waits for the end for at most the given seconds and returns whether it has come.
            look: Function called a few times per second.
            keys: Explanation of the keys, printed at the start.
            actions: Action of each key.
            line: Function that returns the progress line.
        """
        if self._console is None:
            while not wait(_LOOK_S):  # not one endless wait: a signal just before its beginning would not end it
                look()
            return
        with self._console as console:
            self._warn(keys)
            self._shown = console
            while not wait(0):
                look()
                for key in console.keys(_LOOK_S):
                    (actions or {}).get(key, lambda: None)()
                console.progress(line())
            console.progress("")
