"""Signals that end what runs in the foreground."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

__all__ = ["ended_by_signals"]


@contextmanager
def ended_by_signals(end: Callable[[], None]) -> Iterator[None]:
    """Let SIGINT and SIGTERM call something that ends the work, at once when it is the second.

    Outside of the main thread, where Python takes no signals, nothing happens.

    Args:
        end: Called by the first signal, between any two instructions of the main thread.

    Raises:
        KeyboardInterrupt: A second signal has come.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal came
        if came:
            raise KeyboardInterrupt
        came = True
        end()

    former = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, action in former.items():
            signal.signal(number, action)
