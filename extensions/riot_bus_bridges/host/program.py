"""A program that communicates through a bridge of its own; both begin and end together."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from typing import TYPE_CHECKING, Self

from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

_GRACE_S = 3.0  # a guess: from SIGTERM to SIGKILL; the bridge's end waits as long


class Program:
    """A running program with the streams of this process; a context manager that ends it.

    Args:
        command: Program and arguments, in which `{WORD}` is replaced by its value in `words`.
        words: Values of the words in `command`.
        ended: Called on another thread when the program has ended.

    Attributes:
        status: Exit status, negative for a signal, None while it runs.

    Raises:
        EnvironmentFaultError: It cannot be started.
    """

    def __init__(self, command: Sequence[str], words: Mapping[str, str], *, ended: Callable[[], None]) -> None:
        self.status: int | None = None
        try:
            self._process = subprocess.Popen([_filled(part, words) for part in command])
        except OSError as error:
            raise EnvironmentFaultError(
                f"{command[0]!r} cannot be started: {error.strerror or error}", where="bridge"
            ) from error
        self._ended = ended
        self._thread = threading.Thread(target=self._wait, name="bridge-program", daemon=True)
        self._thread.start()

    def _wait(self) -> None:
        self.status = self._process.wait()
        self._ended()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._thread.join(_GRACE_S)
        self._process.kill()
        self._thread.join()


def end_as(status: int) -> None:
    """End this process by the signal that ended a program; return if it ended otherwise."""
    if status < 0:
        signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)


def _filled(text: str, words: Mapping[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(f"{{{word}}}", value)
    return text
