"""Runs of the whole system in the time of the log, which advances when all components are at rest.

Each component has its own segment. Its messages reach the others one at a time, each after all earlier ones have been
processed, in the order of time, component and sequence number, which does not depend on the machine. So a run is
reproducible and as fast as the system allows. A component that waits for the machine's clock counts as at rest; it has
to follow the clock topic.
"""

from __future__ import annotations

import functools
import json
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.processes.activity import Threads
from riot_bus.types.capabilities import RecordedTopic
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.pipeline.event import Event
    from riot_bus.system.system_file import VirtualClock
    from riot_bus.trial.context import Context
    from riot_bus.trial.setup import TrialSetup

_POLL = 0.00005
"""Interval between checks in seconds; a component takes a few hundred microseconds for a message."""
_LONG = 0.5
"""Seconds after which it is also checked whether other processes occupy the processors, which takes a while."""
_BLOCK = Qos(congestion="block")
_NO_SCHEMA = Schema("", "", b"")


class VirtualTime:
    """The time of a run, and an interceptor that holds messages of components until it is their turn.

    Args:
        names: The components, each with a segment of the same name.
        timeout: Seconds after which a component that is still busy counts as hanging.

    Attributes:
        observers: Functions that are called with each message of a run when it is its turn.
        setup: Setup in which the system runs; set before the first run.
    """

    setup: TrialSetup

    def __init__(self, clock: VirtualClock, names: Sequence[str], *, timeout: float) -> None:
        self.observers: list[Callable[[Message], None]] = []
        self._clock, self._names, self._timeout = clock, tuple(names), timeout
        self._time = self._ended = 0
        self._held: list[tuple[str, Message]] = []
        self._lock = threading.Lock()
        self._count = 0

    def begin(self, time: int) -> None:
        """Begin a run: hold what components publish from now on, and remove all observers.

        Args:
            time: Time of the first message, in nanoseconds.
        """
        with self._lock:
            self._time, self._ended, self._count = time, 0, 0
            self._held.clear()
        self.observers.clear()

    def now(self) -> int:
        """Return the time in nanoseconds; after the end of the log it passes in real time."""
        return self._time + (time.monotonic_ns() - self._ended if self._ended else 0)

    def message(self, event: Event) -> None:
        """Hold a message of a component; after the end of the log, let it pass."""
        with self._lock:
            if self._ended:
                self._tell(event.message)
                return
            self._held.append((event.segment, event.message))
        event.drop()

    def play(
        self, messages: Sequence[Message], publish: Callable[[Message], None], *, stop: Callable[[], bool]
    ) -> bool:
        """Give all components each message when those before it have been processed, until the end, a stop or a hang.

        Returns:
            Whether all messages were played.

        Raises:
            ConfigError: No component has subscribed to the clock topic.
        """
        clock = _ClockMessages(self._clock, self.setup, messages) if self._clock.topic else None
        step, tick = round(self._clock.step * 1e9), self._time
        going = self._work_off(stop)
        for message in messages:
            while going and clock and tick <= message.time:
                self._time = tick
                going = self._is_taken(clock.message(tick), clock.missing) and self._work_off(stop)
                tick += step
            if not going:
                break
            self._time = max(self._time, message.time)
            publish(message)
            self._tell(message)
            going = not self.give(message) or self._work_off(stop)
        with self._lock:
            self._ended = time.monotonic_ns()
            left, self._held = self._held, []
        for segment, message in left:
            self._pass_on(segment, message)
        return going

    def _is_taken(self, message: Message, missing: ConfigError) -> bool:
        """Give a message to all components; raise the error if all are alive and none has subscribed to it."""
        if not self.give(message) and self.setup.processes.alive(self._names):
            raise missing
        return True

    def give(self, message: Message, but: str = "") -> bool:
        """Publish a message to all components except `but`; return whether any of them takes it."""
        message = message.with_(qos=_BLOCK)
        taken = [self.setup.network.bus.deliver(name, message) for name in self._names if name != but]
        return any(taken)

    def _pass_on(self, segment: str, message: Message) -> bool:
        self._tell(message)
        return self.give(message, but=segment)

    def _tell(self, message: Message) -> None:
        self._count += 1
        told = message.with_(time=self.now(), sequence=self._count)
        for observe in self.observers:
            observe(told)

    def _work_off(self, stop: Callable[[], bool]) -> bool:
        """Pass on held messages, one whenever all components rest; return False on `stop` or if one never rests."""
        waiting: list[tuple[str, Message]] = []
        while not stop() and self._rest():
            with self._lock:
                held, self._held = self._held, []
            # messages of the same time: by component, and in its own order
            waiting += sorted(held, key=lambda each: (self._names.index(each[0]), each[1].sequence))
            taken = False
            while waiting and not taken:
                taken = self._pass_on(*waiting.pop(0))
            if not taken:
                return True
        with self._lock:
            self._held = waiting + self._held
        return False

    def _rest(self) -> bool:
        """Wait until all components are idle and nothing is in transit; return False if one is busy past the timeout.

        Data sent on this machine wakes its reader before the sender continues, or a kernel thread does so later. So if
        no thread wants a processor, and none has run since before this was looked at, nothing is in transit.
        """
        observation, bus = self.setup.observation, self.setup.network.bus
        threads, own, kernel = observation.threads(self._names), observation.others, _kernel_threads()
        start, held_up, ran = time.monotonic(), None, -1
        while True:
            before, ran = ran, threads.ran()
            if ran == before:  # it is not worth while to look at all threads before
                own_ran = own.ran()
                if not kernel.busy(new=False) and own.rests(own_ran) and threads.rests(ran) and bus.idle():
                    if observation.include_started(self._names):
                        return True
                    threads = observation.threads(self._names)
            if (waited := time.monotonic() - start) > _LONG:
                held_up = held_up or observation.held_up(self._names)
                if waited - held_up() > self._timeout:
                    return False
            time.sleep(_POLL)


class _ClockMessages:
    """Messages that publish the time on the clock topic.

    Attributes:
        missing: Error to raise if no component has subscribed to the topic.

    Raises:
        ConfigError: The topic does not stand for a single key.
    """

    def __init__(self, clock: VirtualClock, setup: TrialSetup, messages: Sequence[Message]) -> None:
        registry, where = setup.context.registry, f"{setup.context.file.path}: system.clock.topic"
        keys = dict.fromkeys(message.key for message in messages)
        topics = [RecordedTopic(registry.topic(key), key, keyed=True, schema=_NO_SCHEMA, encoding="") for key in keys]
        clocks = (adapter.clock(topics, domain=None) for adapter in registry.publishing_adapters())
        known = next((each for each in clocks if each is not None and each.name == clock.topic), None)
        self._number = 0
        self._payload: Callable[[int], bytes] = _as_json if known is None else known.payload
        self._key = single_key(setup.context, clock.topic or "", where=where) if known is None else known.offer.key
        zid = setup.network.bus.segment(next(iter(setup.context.file.components))).zid
        identify = None if known is None else known.offer.identify
        self._attach = None if identify is None else identify(zid, 1).attachment
        self.missing = ConfigError(
            f"no component has subscribed to {clock.topic!r}",
            where=where,
            hint="have components follow this clock (use_sim_time), or leave `topic` out",
        )

    def message(self, now: int) -> Message:
        """Return the message that publishes a time in nanoseconds."""
        self._number += 1
        attachment = self._attach(None, self._number, now) if self._attach else None
        return Message(now, self._key, self._payload(now), attachment=attachment)


def single_key(context: Context, topic: str, *, where: str) -> str:
    """Return the key that a topic stands for.

    Raises:
        ConfigError: It stands for several keys or for none.
    """
    (key,) = context.topics(topic)
    if not key or key.startswith("/") or key.endswith("/") or any(each in key for each in "*$#?"):
        hint = "write the Zenoh key, such as `robot/reset`"
        raise ConfigError(f"{topic!r} does not stand for a single key", where=where, hint=hint)
    return key


def _as_json(now: int) -> bytes:
    return json.dumps({"sec": now // 10**9, "nanosec": now % 10**9}).encode()


@functools.cache
def _kernel_threads() -> Threads:
    """Return the kernel threads that forward network data; none are visible in a container."""
    found = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdecimal() and (entry / "comm").read_bytes().startswith(b"ksoftirqd/"):
                found.append(int(entry.name))
    threads = Threads(found)
    threads.busy()  # opens their files, once for all runs of this process
    return threads
