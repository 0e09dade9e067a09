"""Signals that end what runs in the foreground."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from types import FrameType

__all__ = ["ended_by_signals"]


def _interrupt() -> None:
    raise KeyboardInterrupt


@contextmanager
def ended_by_signals(
    end: Callable[[], None],
    *,
    again: Callable[[], None] = _interrupt,
    others: Mapping[signal.Signals, Callable[[], None]] | None = None,
) -> Iterator[None]:
    """Let SIGINT and SIGTERM call something that ends the work, at once when it is the second.

    Outside of the main thread, where Python takes no signals, nothing happens.

    Args:
        end: Called by the first signal, between any two instructions of the main thread.
        again: Called by further ones.
        others: What other signals call.

    Raises:
        KeyboardInterrupt: A second signal has come, unless `again` is something else.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal came
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
        for number, before in former.items():
            signal.signal(number, before)
