"""Playback of logs into a network: start, control, observe, stop; for the command line and for agents."""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.commands import Command, reporting
from riot_bus.control.server import Control, free_name
from riot_bus.log.playback.pace import SteadyPace
from riot_bus.log.playback.player import Player
from riot_bus.play.lockstep import Acknowledged, Quiet
from riot_bus.play.playback_plan import PlaybackPlan
from riot_bus.play.publisher_conflicts import PublisherConflicts
from riot_bus.play.publishing import Publishing
from riot_bus.play.simclock import Ticker
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from riot_bus.control.commands import CommandRequest
    from riot_bus.play.lockstep import Settling
    from riot_bus.play.options import PlayOptions
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_FLUSH_S = 10.0
_END_S = _FLUSH_S + 5.0
SHOWN = 5  # topics that a message names
_CONFIG = {
    "timestamping/enabled": True,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 60_000_000,  # microseconds; 5 s are the usual
}
UNDER = "play/**"
"""The keys of these commands, below the player's own."""

_MOST_STEPS = 1_000_000  # a guess: more is probably a mistake; `resume` plays all messages


@dataclass(frozen=True, slots=True)
class PlayResult:
    """Result of a playback.

    Attributes:
        passes: Number of times that the logs were begun.
        lateness: Seconds that messages were late: `p50`, `p99` and `max`.
        problems: The first error by topic, and other failures.
        unread: Messages that could not be read, by log.
        unsettled: Number of messages in lock-step after which subscribers did not settle in time.
    """

    published: int = 0
    seconds: float = 0.0
    passes: int = 0
    stopped: bool = False
    lateness: dict[str, float] = field(default_factory=dict)
    lost: Counter[str] = field(default_factory=Counter)
    problems: dict[str, str] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)
    unsettled: int = 0

    def __bool__(self) -> bool:
        """Whether everything was read and published."""
        return not (self.lost or self.problems or self.unread)


class PlayService:
    """Playback of logs; as a context manager, it starts on entry and stops on exit.

    Raises:
        ConfigError: A log, option, plan or interceptor is not usable.
    """

    def __init__(self, options: PlayOptions, *, warn: Callable[[str], None] = _LOG.warning) -> None:
        self.options = options
        self.name = options.name
        self._warn = warn
        self.programme = PlaybackPlan(options)
        lockstep = bool(options.lockstep) or options.ack is not None
        self.player = Player(
            self.programme.source,
            self._publish,
            pace=SteadyPace(),
            rate=options.rate,
            loop=options.loop,
            delay=options.delay,
            paused=options.paused,
            hold=options.hold,
            settle=self._settle if lockstep else None,
        )
        self._stack = ExitStack()
        self._publishing: Publishing
        self._settling: Settling | None = None
        self._ticker: Ticker | None = None
        self._waiting = True
        self._unmatched: set[str] = set()
        self._stopped = False
        self._give_up = math.inf
        self._done = threading.Event()
        self._failure = ""
        self._seconds = 0.0
        self._thread = threading.Thread(target=self._run, name="riot-play", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is KeyboardInterrupt:
            self._give_up = 0.0
        self.close()

    # -- life ---------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Connect and begin; return without waiting for subscribers.

        Raises:
            EnvironmentFaultError: No router answers at the endpoint.
        """
        options, cast = self.options, self.programme.cast
        with ExitStack() as stack:
            stack.callback(self.programme.close)
            prepare_runtime()
            config = client_config(options.endpoint, extra={**_CONFIG, **options.config})
            session = open_session(config, purpose="player")
            stack.callback(release, session)
            rivals = PublisherConflicts(session, set(cast.offers), self.programme.registry, self._rival)
            rivals.look()
            stack.callback(rivals.close)
            offers = {**cast.offers, **({cast.clock.offer.key: cast.clock.offer} if cast.clock is not None else {})}
            nothing_dropped = options.rate == 0 or self.player.in_lockstep
            self._publishing = Publishing(session, offers, block=nothing_dropped)
            stack.callback(self._publishing.close)
            self._watch(session, stack)
            if options.control:
                self.name = free_name(session, options.name, "play")
                stack.enter_context(Control(self, self.name, {"": session}, commands=PLAY_COMMANDS, under=UNDER))
            for line in self.programme.warnings:
                self._warn(line)
            self._stack = stack.pop_all()
        self._thread.start()
        self._stack.callback(self._end_thread)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end; return whether it has ended, or hangs although it was told to end long ago."""
        return self._done.wait(timeout) or time.monotonic() > self._give_up

    def close(self) -> None:
        """Stop and disconnect; safe to call twice."""
        self._stack.close()
        self.programme.close()

    # -- commands -----------------------------------------------------------------------------------------------------

    def pause(self) -> None:
        """Pause the playback."""
        self.player.pause()

    def resume(self) -> None:
        """Resume the playback."""
        self.player.resume()

    def step(self, count: int = 1) -> None:
        """Publish the next messages at once, then pause."""
        self.player.step(count)

    def seek(self, seconds: float) -> None:
        """Continue from a position, in seconds after the beginning of the logs."""
        self.player.seek(self.programme.origin + int(seconds * 1e9))

    def set_rate(self, rate: float) -> None:
        """Continue at another speed; raises ConfigError if it is invalid."""
        self.player.set_rate(rate)

    def stop(self) -> None:
        """End as soon as possible; does not wait for it."""
        if not self._stopped:
            self._give_up = time.monotonic() + _END_S
        self._stopped = True
        self.player.stop()

    # -- what is going on ---------------------------------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Return the state as JSON values; times are in seconds from the beginning of the logs."""
        status, origin = self.player.status(), self.programme.origin
        state = "waiting" if self._waiting and status.state == "ready" else status.state
        return {
            "name": self.name,
            "pid": os.getpid(),
            "logs": [str(path) for path in self.options.logs],
            "state": "ended" if self._done.is_set() else state,
            "position": (status.position - origin) / 1e9,
            "start": (status.start - origin) / 1e9,
            "end": (status.end - origin) / 1e9,
            "rate": status.rate,
            "loop": self.options.loop,
            "pass": status.passes,
            "published": status.published,
            "lost": self._publishing.lost.total(),
            "lateness": self._lateness(),
            "unsettled": self._settling.unsettled if self._settling is not None else 0,
        }

    def result(self) -> PlayResult:
        """Return the result so far."""
        status, publishing, name = self.player.status(), self._publishing, self.programme.name
        problems = {name(key): text for key, text in publishing.problems.items()}
        if publishing.broken:
            problems["link"] = f"the link to {redacted(self.options.endpoint)} broke {publishing.broken} times"
        if self._failure:
            problems["player"] = self._failure
        elif not self._done.is_set() and time.monotonic() > self._give_up:
            problems["player"] = f"it did not end within {_END_S:g} s: an interceptor or a file hangs"
        return PlayResult(
            published=status.published,
            seconds=self._seconds,
            passes=status.passes,
            stopped=self._stopped,
            lateness=self._lateness(),
            lost=Counter({name(key): number for key, number in publishing.lost.items()}),
            problems=problems,
            unread=self.programme.losses(),
            unsettled=self._settling.unsettled if self._settling is not None else 0,
        )

    def _lateness(self) -> dict[str, float]:
        lateness = self.player.lateness
        return {"p50": lateness.quantile(0.5), "p99": lateness.quantile(0.99), "max": lateness.worst}

    # -- playing ------------------------------------------------------------------------------------------------------

    def _watch(self, session: zenoh.Session, stack: ExitStack) -> None:
        options, clock = self.options, self.programme.cast.clock
        if options.ack is not None:
            key = self.programme.registry.key_expression(options.ack)
            self._settling = Acknowledged(session, [key], timeout=options.settle_timeout)
        elif options.lockstep:
            keys = [self.programme.registry.key_expression(each) for each in options.lockstep]
            self._settling = Quiet(session, keys, window=options.quiet, timeout=options.settle_timeout)
        if self._settling is not None:
            stack.callback(self._settling.close)
        if clock is not None:
            self._ticker = Ticker(clock, self._publishing.publish, lambda: self.player.status().position, options.clock)
            stack.callback(self._ticker.close)

    def _run(self) -> None:
        began = time.monotonic()
        try:
            self._wait_matched()
            if self._ticker is not None:
                self._ticker.start()
            began = time.monotonic()
            self.player.run()
            self._seconds = time.monotonic() - began
            if not self._publishing.flush(_FLUSH_S):
                self._failure = f"the router did not take the last messages within {_FLUSH_S:g} s"
            self._warn_of_leavers()
        except Exception as error:
            if not isinstance(error, OSError | RiotError):
                _LOG.exception("the play failed")
            self._failure = str(error) or repr(error)
            self._seconds = time.monotonic() - began
        finally:
            self.programme.finish()
            if self.programme.pipeline is not None:
                self.programme.pipeline.close()
            self._done.set()

    def _wait_matched(self) -> None:
        deadline = time.monotonic() + self.options.wait
        while (unmatched := self._publishing.unmatched()) and time.monotonic() < deadline and not self._stopped:
            time.sleep(0.002)
        self._waiting = False
        self._unmatched = set(unmatched)
        if unmatched and self.options.wait and not self._stopped:
            self._warn(f"after {self.options.wait:g} s there is no subscriber to {self._names(unmatched)}")

    def _warn_of_leavers(self) -> None:
        """Warn of lost subscribers: a router disconnects one that holds up others for too long."""
        gone = set(self._publishing.unmatched()) - self._unmatched
        if gone and not self._stopped:
            self._warn(f"at the end there is no longer a subscriber to {self._names(gone)}")

    def _names(self, keys: Collection[str]) -> str:
        names = sorted(map(self.programme.name, keys))
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        return ", ".join(names[:SHOWN]) + more

    def _publish(self, message: Message) -> None:
        if self._ticker is not None:
            self._ticker.before(message.time)
        if self._settling is not None:
            self._settling.sent()
        self._publishing.publish(message)

    def _settle(self, given_up: Callable[[], bool]) -> None:
        if self._settling is not None:
            self._settling.wait(given_up)

    def _rival(self, key: str, who: str) -> None:
        name = self.programme.name(key)
        self._warn(
            f"{who} publishes {name} already: subscribers get both; leave it out (--exclude {name}) "
            f"or rename it (--remap {name}:=/replay{name if name.startswith('/') else f'/{name}'})"
        )

    def _end_thread(self) -> None:
        self.stop()
        self._thread.join(max(0.0, self._give_up - time.monotonic()))


def _step(service: PlayService, request: CommandRequest) -> None:
    count = request.number("count", 1.0)
    if not 1 <= count <= _MOST_STEPS or count != int(count):
        raise ConfigError(f"{count:g} is not a number of steps", hint=f"1 to {_MOST_STEPS}")
    service.step(int(count))


PLAY_COMMANDS: dict[str, Command] = {
    "play/status": Command(lambda service, _: service.status(), reads=True, urgent=True),
    "play/pause": reporting(lambda service, _: service.pause(), urgent=True),
    "play/resume": reporting(lambda service, _: service.resume(), urgent=True),
    "play/step": reporting(_step),
    "play/seek": reporting(lambda service, request: service.seek(request.number("time"))),
    "play/rate": reporting(lambda service, request: service.set_rate(request.number("rate"))),
    "play/stop": reporting(lambda service, _: service.stop(), urgent=True),
}
"""All commands by name; each answers with the status."""
