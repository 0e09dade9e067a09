"""Signals that end a run in the foreground, and a forced end that no thread can block."""

from __future__ import annotations

import faulthandler
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType

END_S = 30.0
"""Time allowed for an orderly end: routers end within a second, recorders still write their queue to disk."""


def force_end_after(seconds: float) -> None:
    """End this process after some seconds, whatever its threads are doing, and print their tracebacks to stderr.

    This needs no Python code to run: a thread that never releases the interpreter, or never ends, cannot prevent it. A
    later call replaces an earlier one.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=2)  # stderr, whatever `sys.stderr` is


def let_run() -> None:
    """Cancel `force_end_after`."""
    faulthandler.cancel_dump_traceback_later()


def _interrupt() -> None:
    raise KeyboardInterrupt


@contextmanager
def ended_by_signals(
    end: Callable[[], None],
    *,
    again: Callable[[], None] = _interrupt,
    others: Mapping[signal.Signals, Callable[[], None]] | None = None,
    deadline: float = END_S,
) -> Iterator[None]:
    """Let the first SIGINT or SIGTERM end the work in good order, and a second one end it at once.

    If the work has not ended by the deadline, the process is ended by force; after the `with` block, nothing is forced.

    Outside the main thread, where Python handles no signals, nothing is installed.

    Args:
        end: Called on the first signal, between any two instructions of the main thread.
        again: Called on each further signal.
        others: Callbacks for other signals.
        deadline: Seconds from the first signal on.

    Raises:
        KeyboardInterrupt: A second signal came and `again` was left at its default.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal came
        if not came:
            force_end_after(deadline)
        action, came = again if came else end, True
        action()

    def other(number: int, frame: FrameType | None) -> None:
        actions[signal.Signals(number)]()

    actions = dict(others or {})
    former = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    former |= {number: signal.signal(number, other) for number in actions}
    try:
        yield
    finally:
        let_run()
        for number, before in former.items():
            signal.signal(number, before)
