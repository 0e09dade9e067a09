"""Signals that end what runs in the foreground, and ends that no thread can hold up."""

from __future__ import annotations

import faulthandler
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from types import FrameType

__all__ = ["END_S", "ended_by_signals", "force_end_after", "let_run"]

END_S = 30.0
"""How long an orderly end may take: routers end within a second, recorders write what waits for the disk."""

_STDERR = 2


def force_end_after(seconds: float) -> None:
    """End this process after some seconds, whatever its threads do by then, and say on stderr what they did.

    It needs no Python: neither a thread that never lets others have the interpreter, nor one that never ends, is in the
    way. A later call takes the place of a former one.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=_STDERR)


def let_run() -> None:
    """Take back `force_end_after`."""
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
    """Let SIGINT and SIGTERM call something that ends the work, at once when it is the second.

    If the work has not ended by the deadline, the process ends all the same; behind that, nothing is forced.

    Outside of the main thread, where Python takes no signals, nothing happens.

    Args:
        end: Called by the first signal, between any two instructions of the main thread.
        again: Called by further ones.
        others: What other signals call.
        deadline: Seconds from the first signal on.

    Raises:
        KeyboardInterrupt: A second signal has come, unless `again` is something else.
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
