"""Runs of the whole system in the time of the log: it goes on when all components are at rest.

Each component has a segment of its own, and what one publishes gets to the others one message after the other, each
when all before it have been worked off: in the order of time, component and number, which does not depend on the
machine. So a run is as fast as the system can be, and one like the other. Components that wait for a time of the
machine's clock are at rest for riot; they have to follow the clock topic.
"""

from __future__ import annotations

import json
import threading
import time
from typing import TYPE_CHECKING

from riot_bus.vocabulary.message import Message, Qos

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.pipeline.event import Event
    from riot_bus.sut.stage import TrialSetup
    from riot_bus.sut.system import VirtualClock

__all__ = ["VirtualTime"]

_POLL = 0.0002
"""A component takes some hundred microseconds for a message."""
_LONG = 0.5
"""From then on it is looked at whether others have the processors: that takes a while."""
_BLOCK = Qos(congestion="block")


class VirtualTime:
    """The time of a run, and an interceptor that holds messages of components until it is their turn.

    Args:
        clock: How the time is told.
        names: The components, each with a segment of its name.
        timeout: Seconds after which a component that is still busy hangs.

    Attributes:
        observers: Called with each message of a run when it is its turn.
    """

    def __init__(self, clock: VirtualClock, names: Sequence[str], *, timeout: float) -> None:
        self.observers: list[Callable[[Message], None]] = []
        self._clock, self._names, self._timeout = clock, tuple(names), timeout
        self._time = self._ended = 0
        self._held: list[tuple[str, Message]] = []
        self._lock = threading.Lock()
        self._count = 0

    def begin(self, time: int) -> None:
        """Begin a run: what components publish from now on is held, and nobody observes it yet.

        Args:
            time: Of its first message, in nanoseconds.
        """
        with self._lock:
            self._time, self._ended, self._count = time, 0, 0
            self._held.clear()
        self.observers.clear()

    def now(self) -> int:
        """Return the time, in nanoseconds; after the log it passes like that of the machine."""
        return self._time + (time.monotonic_ns() - self._ended if self._ended else 0)

    def message(self, event: Event) -> None:
        """Hold a message of a component; after the log, let it pass."""
        with self._lock:
            if self._ended:
                self._tell(event.message)
                return
            self._held.append((event.segment, event.message))
        event.drop()

    def play(
        self,
        messages: Sequence[Message],
        stage: TrialSetup,
        publish: Callable[[Message], None],
        *,
        stop: Callable[[], bool],
    ) -> None:
        """Give messages to all components, each when all before it have been worked off; to the end, a stop or a hang.

        Args:
            messages: In the order of their times.
            stage: Where the system runs.
            publish: Told each message when it is its turn.
            stop: True when nothing more need be published.
        """
        key, payload = _told_on(self._clock, stage)
        step, tick = round(self._clock.step * 1e9), self._time
        going = self._work_off(stage, stop)
        for message in messages:
            while going and key and tick <= message.time:
                self._time = tick
                going = not self.give(stage, Message(tick, key, payload(tick))) or self._work_off(stage, stop)
                tick += step
            if not going:
                break
            self._time = max(self._time, message.time)
            publish(message)
            self._tell(message)
            going = not self.give(stage, message) or self._work_off(stage, stop)
        with self._lock:
            self._ended = time.monotonic_ns()
            left, self._held = self._held, []
        for segment, message in left:
            self._pass_on(stage, segment, message)

    def give(self, stage: TrialSetup, message: Message, but: str = "") -> bool:
        """Publish a message to all components but one; return whether one takes it."""
        message = message.with_(qos=_BLOCK)
        taken = [stage.bus.deliver(name, message) for name in self._names if name != but]
        return any(taken)

    def _pass_on(self, stage: TrialSetup, segment: str, message: Message) -> bool:
        self._tell(message)
        return self.give(stage, message, but=segment)

    def _tell(self, message: Message) -> None:
        self._count += 1
        told = message.with_(time=self.now(), sequence=self._count)
        for observe in self.observers:
            observe(told)

    def _work_off(self, stage: TrialSetup, stop: Callable[[], bool]) -> bool:
        """Pass on what is held, the first message each time all are at rest; False if one never is, or for `stop`."""
        waiting: list[tuple[str, Message]] = []
        while not stop() and self._rest(stage):
            with self._lock:
                held, self._held = self._held, []
            # what came at the same time: of each component in its own order
            waiting += sorted(held, key=lambda each: (self._names.index(each[0]), each[1].sequence))
            taken = False
            while waiting and not taken:
                taken = self._pass_on(stage, *waiting.pop(0))
            if not taken:
                return True
        return False

    def _rest(self, stage: TrialSetup) -> bool:
        """Wait until no component does anything, and nothing is on its way; False if one is busy to the deadline.

        What is sent on this machine wakes who reads it before the sender goes on. So where no thread wants the
        processor, seen twice with nothing that had run in between, nothing is on its way.
        """
        threads, own = stage.threads(self._names), stage.others
        start, held_up = time.monotonic(), None

        def nothing_runs(*, new: bool) -> bool:
            return stage.bus.idle() and not own.busy(new=new) and not threads.busy(new=new)

        while True:
            if nothing_runs(new=True):
                before = threads.switches(), own.switches()
                if nothing_runs(new=False) and (threads.switches(), own.switches()) == before:
                    return True
            if (waited := time.monotonic() - start) > _LONG:
                held_up = held_up or stage.held_up(self._names)
                if waited - held_up() > self._timeout:
                    return False
            time.sleep(_POLL)


def _told_on(clock: VirtualClock, stage: TrialSetup) -> tuple[str, Callable[[int], bytes]]:
    """Return the key on which the time is told, empty if it is not, and what makes a payload of it."""
    if clock.topic is None:
        return "", lambda now: b""
    for adapter in stage.context.registry.publishing_adapters():
        known = adapter.clock((), domain=None)
        if known is not None and known.name == clock.topic:
            return known.offer.key, known.payload
    return clock.topic, lambda now: json.dumps({"sec": now // 10**9, "nanosec": now % 10**9}).encode()
