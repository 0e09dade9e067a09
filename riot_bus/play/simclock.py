"""`/clock`: the player's time, for nodes that follow it instead of the machine's time."""

from __future__ import annotations

import threading
from time import monotonic
from typing import TYPE_CHECKING

from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.types.capabilities import SimClock


class Ticker:
    """Publishes the time at a constant frequency, also while the player is paused, and always before newer messages."""

    def __init__(
        self, clock: SimClock, publish: Callable[[Message], None], position: Callable[[], int], hertz: float
    ) -> None:
        self._clock, self._publish, self._position = clock, publish, position
        self._period_s = 1.0 / hertz
        self._period = int(1e9 / hertz)
        self._lock = threading.Lock()
        self._told = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="riot-clock", daemon=True)

    def start(self) -> None:
        """Begin."""
        with self._lock:
            self._tell(self._position())
        self._thread.start()

    def before(self, time: int) -> None:
        """Publish the time of a message that is about to be published, unless this was done recently."""
        with self._lock:  # a time that the other thread publishes has to be out before the message
            if not 0 <= time - self._told < self._period:
                self._tell(time)

    def close(self) -> None:
        """End."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    def _tell(self, time: int) -> None:
        self._told = time
        self._publish(Message(time, self._clock.offer.key, self._clock.payload(time)))

    def _run(self) -> None:
        due = monotonic()
        while True:
            due = max(due + self._period_s, monotonic())  # missed messages are not made up for
            if self._ending.wait(due - monotonic()):
                return
            with self._lock:
                self._tell(self._position())
