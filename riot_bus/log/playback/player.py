"""Plays messages in their order, at their own pace or as fast as possible.

`play` does so from beginning to end. A `Player` can be paused, stepped, sought and sped up while it plays.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from riot_bus.log.playback.lateness import Lateness
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from riot_bus.log.playback.pace import Pace
    from riot_bus.log.playback.sources import Source
    from riot_bus.vocabulary.clock import Clock
    from riot_bus.vocabulary.message import Message

_STOP_S = 0.2  # only a source that hangs keeps the lock longer; then the flag must do
_SLOWEST, _FASTEST = 1e-6, 1e6  # far beyond any use; a rate near 0 would make waits infinite (OverflowError)

PlayState = Literal["ready", "playing", "paused", "ended"]


def play(
    messages: Iterable[Message],
    publish: Callable[[Message], None],
    *,
    rate: float = 0.0,
    clock: Clock,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Publish messages in exactly this order.

    Deadlines count from the first message, so lateness does not add up; a message whose time lies before its
    predecessor's is published at once.

    Args:
        messages: Messages of a log.
        publish: Function called for each message.
        rate: Speed relative to the log's own; 0 is as fast as possible.
        clock: Clock that paces the replay.
        stop: Function that tells whether to stop, called before each message and while waiting.

    Raises:
        ConfigError: The rate is not valid.
    """
    check_rate(rate)
    begun = clock.now()
    first: int | None = None
    for message in messages:
        first = message.time if first is None else first
        due = begun + int((message.time - first) / rate) if rate else begun
        while (now := clock.now()) < due and not stop():
            clock.sleep_until(min(due, now + 10**8))  # a stop takes effect within 0.1 s
        if stop():
            return
        publish(message)


def check_rate(rate: float) -> float:
    """Return the rate; raises ConfigError if it is neither 0 nor between a millionth and a million."""
    if rate and not _SLOWEST <= rate <= _FASTEST:
        hint = "give a number from 0.000001 to 1000000, or 0 for as fast as possible"
        raise ConfigError(f"rate {rate} is not a speed", hint=hint)
    return rate


@dataclass(frozen=True, slots=True)
class PlayStatus:
    """The state of a player.

    Attributes:
        passes: Number of the present pass, from 1.
    """

    state: PlayState
    position: int
    start: int
    end: int
    rate: float
    passes: int
    published: int


class Player:
    """Plays a source; commands may come from any thread at any time.

    The log's time is counted from an anchor, at the rate, so lateness does not add up; pausing, seeking and changing
    the rate set a new anchor. Messages are published by the thread that calls `run`, one by one in the source's order.

    Args:
        source: Messages in the order of their times.
        publish: Function called for each message; an exception from it ends the play.
        pace: Source of the time.
        rate: Speed relative to the log's own; 0 is as fast as possible.
        loop: Whether to begin again at the end, until stopped.
        delay: Seconds before each pass.
        paused: Whether to begin paused.
        hold: Whether to wait for commands at the end instead of ending.
        settle: Function called after each message; time stands still until it returns. Its argument is a function that
            tells when to give up.

    Attributes:
        lateness: Delays of messages, if a pace was asked for.

    Raises:
        ConfigError: The rate is not valid.
    """

    def __init__(
        self,
        source: Source,
        publish: Callable[[Message], None],
        *,
        pace: Pace,
        rate: float = 1.0,
        loop: bool = False,
        delay: float = 0.0,
        paused: bool = False,
        hold: bool = False,
        settle: Callable[[Callable[[], bool]], object] | None = None,
    ) -> None:
        self.lateness = Lateness()
        self._source, self._publish, self._pace = source, publish, pace
        self._rate, self._loop, self._delay = check_rate(rate), loop, int(delay * 1e9)
        self._paused, self._hold, self._settle = paused, hold, settle
        self._bell = threading.Condition()
        self._steps = self._passes = self._published = 0
        self._running = self._settling = self._ended = self._stopped = False
        self._messages: Iterator[Message] = iter(())
        self._upcoming: Message | None = None
        self._barren = False  # whether this pass has had no message so far, from the very beginning
        self._exhausted = False  # whether this pass has no more messages
        self._reading = False
        self._fresh = False  # whether reading has just begun
        self._log = self._last = source.start  # `_log` is the anchor's time in the log
        self._wall = 0  # the anchor's time on the clock

    @property
    def in_lockstep(self) -> bool:
        """Whether each message waits until the one before has had its effect."""
        return self._settle is not None

    # -- commands -----------------------------------------------------------------------------------------------------

    def pause(self) -> None:
        """Stop time; the next message waits."""
        with self._bell:
            if not self._paused:
                self._log = self._position()
                self._paused = True
                self._bell.notify_all()

    def resume(self) -> None:
        """Let time continue."""
        with self._bell:
            if self._paused:
                self._paused = False
                self._steps = 0
                self._wall = self._pace.now()
                self._bell.notify_all()

    def step(self, count: int = 1) -> None:
        """Publish the next messages at once, then pause."""
        with self._bell:
            self.pause()
            self._steps += max(0, count)
            self._bell.notify_all()

    def seek(self, time: int) -> None:
        """Continue from another time, clamped to the log's time span; pending steps are discarded."""
        with self._bell:
            self._begin(min(max(time, self._source.start), self._source.end))
            self._barren = False
            self._steps = 0
            self._bell.notify_all()

    def set_rate(self, rate: float) -> None:
        """Continue at another speed; raises ConfigError if it is not valid."""
        check_rate(rate)
        with self._bell:
            now = self._pace.now()
            if now > self._wall or not self._running:
                self._log, self._wall = self._position(), max(now, self._wall)
            self._rate = rate
            self._bell.notify_all()

    def stop(self) -> None:
        """End as soon as possible; safe to call at any time, even if the source hangs."""
        self._stopped = True
        if self._bell.acquire(timeout=_STOP_S):
            self._bell.notify_all()
            self._bell.release()

    def status(self) -> PlayStatus:
        """Return the present state."""
        with self._bell:
            state: PlayState = "paused" if self._paused else "playing"
            if not self._running:
                state = "ready"
            if self._ended:
                state = "ended"
            source = self._source
            return PlayStatus(
                state, self._position(), source.start, source.end, self._rate, self._passes, self._published
            )

    # -- playing ------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Play until the end or `stop`; to be called only once."""
        with self._bell:
            self._running = True
            self._passes = 1
            self._barren = True
            self._begin(self._log, delay=self._delay)
        try:
            while (message := self._next()) is not None:
                self._publish(message)
                self._published += 1
                if self._settle is not None:
                    self._wait_settled(self._settle)
        finally:
            with self._bell:
                self._log = self._position()
                self._ended = True
                self._close_messages()

    def _next(self) -> Message | None:
        """Wait for the next message and take it; None at the end."""
        with self._bell:
            while not self._stopped:
                message = self._upcoming
                if message is None and not self._exhausted:
                    self._fetch()
                    continue
                if message is None:
                    if not self._hold:
                        return None
                    self._log, self._ended = self._source.end, True
                    self._pace.wait(self._bell, None)
                    continue
                if self._steps:
                    self._steps -= 1
                elif self._paused:
                    self._pace.wait(self._bell, None)
                    continue
                elif self._rate:
                    due = self._wall + int((message.time - self._log) / self._rate)
                    late = self._pace.now() - due
                    if late < 0:
                        self._pace.wait(self._bell, due)
                        continue
                    self.lateness.add(late)
                elif self._wall > self._pace.now():
                    self._pace.wait(self._bell, self._wall)
                    continue
                if self._paused or not self._rate:
                    self._log = message.time
                self._upcoming, self._last = None, message.time
                return message
            return None

    def _fetch(self) -> None:
        """Read the next message, with the lock released: other threads can give commands however long it takes."""
        messages, self._reading = self._messages, True
        self._bell.release()
        try:
            message = next(messages, None)
        finally:
            self._bell.acquire()
            self._reading = False
        if messages is not self._messages:  # `seek` was called meanwhile
            _close(messages)
        elif message is not None:
            self._upcoming, self._barren = message, False
            if self._fresh:  # time for opening and decompressing the log does not count as lateness
                self._fresh = False
                self._wall = max(self._wall, self._pace.now())
        elif self._loop and not self._barren:
            self._passes += 1
            self._barren = True
            self._begin(self._source.start, delay=self._delay)
        else:
            self._exhausted = True

    def _begin(self, time: int, *, delay: int = 0) -> None:
        self._close_messages()
        self._messages = iter(self._source.messages(time if time > self._source.start else None))
        self._log, self._last, self._wall = time, time, self._pace.now() + delay
        self._ended = self._exhausted = False
        self._fresh = True

    def _close_messages(self) -> None:
        self._upcoming = None
        if not self._reading:
            _close(self._messages)

    def _position(self) -> int:
        if self._paused or self._settling or self._ended or not (self._rate and self._running):
            return self._log
        passed = max(0, self._pace.now() - self._wall)
        limit = self._last if self._upcoming is None else self._upcoming.time
        return min(self._log + int(passed * self._rate), max(limit, self._log))

    def _wait_settled(self, settle: Callable[[Callable[[], bool]], object]) -> None:
        with self._bell:
            self._log, self._settling = self._position(), True
        try:
            settle(lambda: self._stopped)
        finally:
            with self._bell:
                self._settling = False
                self._wall = max(self._wall, self._pace.now())


def _close(messages: Iterator[Message]) -> None:
    close = getattr(messages, "close", None)
    if close is not None:
        close()
