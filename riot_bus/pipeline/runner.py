"""Run messages through interceptors, sans-I/O: one message in, messages with due times out.

The same pipeline runs on the live bus, over a log and in property tests. It has no clock: time is the message's time.
A `Pipeline` is not thread-safe; feed it from one thread at a time.
"""

from __future__ import annotations

import threading
import traceback
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.conditions import always
from riot_bus.pipeline.event import Arrival, Change, Event, check
from riot_bus.pipeline.stage import InterceptorErrors, Stage, stages_of
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.message import CACHED_KEYS

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence

    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

OTHER_TOPICS = "(other topics)"
"""Name under which all topics beyond `MOST_TOPICS` are counted."""

MOST_TOPICS = 1 << 16
"""Number of topics that are counted separately, so that invented keys cannot exhaust the memory."""


class BoundedCounts(Counter[str]):
    """Counts by topic or key in bounded memory: once there are too many topics, new ones share one count."""

    def add(self, topic: str, number: int = 1) -> None:
        """Add to the count of a topic."""
        if topic not in self and len(self) >= MOST_TOPICS:
            topic = OTHER_TOPICS
        self[topic] += number


class AbandonedError(RiotError):
    """The message that this thread worked on was taken from it, because an interceptor blocked too long."""


@dataclass(frozen=True, slots=True)
class Emission:
    """One message to deliver at `due` (nanoseconds).

    Attributes:
        original: None for a message that an interceptor added.
        targets: Segments to deliver to; None for all that the original goes to.
    """

    due: int
    message: Message
    original: Message | None
    changes: tuple[Change, ...] = ()
    targets: tuple[str, ...] | None = None

    @property
    def counted_key(self) -> str:
        """The key under which the pipeline has counted it, even if its message has another key by now."""
        return (self.original or self.message).key

    def message_when_due(self) -> Message:
        """Return the message with `due` as its time, as it arrives at a receiver."""
        return self.message if self.message.time == self.due else self.message.with_(time=self.due)


@dataclass(frozen=True, slots=True)
class Result:
    """Result for one message; a dropped one has no emission of its own, but its changes say why."""

    original: Message
    emissions: tuple[Emission, ...]
    changes: tuple[Change, ...] = ()
    dropped: bool = False


@dataclass(slots=True)
class Counts:
    """What happened to one topic's messages: `delivered == seen - dropped + copies + added`.

    A message that is handled differently for different segments counts as a copy for each further variant.
    """

    seen: int = 0
    changed: int = 0
    dropped: int = 0
    delayed: int = 0
    copies: int = 0
    added: int = 0
    delivered: int = 0


@dataclass(slots=True)
class Route:
    """Properties of the messages of one key: topic, counts, the interceptors that want them, and their type.

    Attributes:
        first: Number of messages seen at the last call of `Pipeline.restart`.
    """

    topic: str
    counts: Counts
    stages: tuple[tuple[Stage, Callable[[Event], bool]], ...]
    kind: MessageType | None
    first: int = 0


class Pipeline:
    """A sequence of interceptors.

    An interceptor has `message(event)` and may have `name`, `topics` (selectors or key expressions that it wants,
    default all), `load(registry)` (called here; may raise ConfigError), `start()` (before the first message), `stop()`
    (by `close`), `joined(component)` and `left(component)`. One that raises is isolated: the message continues as it
    was before that interceptor, and the error is counted in `errors`. Messages that an interceptor adds are delivered
    unchanged.

    Args:
        interceptors: Interceptors in the order of calls, under conditions if they are `Selective`; a dropped message
            does not reach the later ones.
        registry: Names and types of topics.
        start: Time zero of `Event.seconds`; default is the first message's time.
        provenance: Whether changes say which value was replaced by which; costs two more reads per change.

    Raises:
        ConfigError: An object has no `message` method, or its `load` refuses.
    """

    def __init__(
        self,
        interceptors: Sequence[object],
        *,
        registry: TypeRegistry,
        start: int | None = None,
        provenance: bool = True,
    ) -> None:
        self.errors: dict[str, InterceptorErrors] = {}
        self.counts: dict[str, Counts] = {}
        self.provenance = provenance
        self.current: list[Stage] = []
        """The interceptor that is being called, if any; a new list for each call."""
        self._registry = registry
        self._origin = start
        self._before: dict[str, int] = {}
        self._running = False
        self._started: dict[int, Stage] = {}
        self._routes: dict[str, Route] = {}
        self._fed: Route | None = None  # while a message is fed
        self.stages: tuple[Stage, ...] = ()
        self.replace(interceptors)

    def replace(self, interceptors: Sequence[object]) -> None:
        """Continue with other interceptors; those that stay are neither stopped nor started again.

        Raises:
            ConfigError: As for the constructor; then nothing has changed.
            AbandonedError: `abandon` was called meanwhile: the next message starts the others, and `close` stops the
                removed ones.
        """
        stages = stages_of(interceptors)
        before = {id(stage.interceptor): stage for stage in self.stages}
        for stage in stages:
            known = before.get(id(stage.interceptor))
            if known is not None:
                stage.bypassed = known.bypassed
            elif (load := stage.hook("load")) is not None:
                load(self._registry)
        self.stages = stages
        self._routes.clear()
        if self._running:
            self._running = False  # if an interceptor is abandoned meanwhile, the next message starts the others
            self._stop(keep={id(stage.interceptor) for stage in stages})
            self.start()

    def feed(self, message: Message, *, targets: tuple[str, ...] = ()) -> Result:
        """Run one message through all interceptors that want it."""
        route = self._routes.get(message.key) or self.route(message.key)
        event = self.run(route, message.time, message=message, segment=message.segment, targets=targets)
        return self.result(event, route)

    def passes(self, message: Message) -> bool:
        """Count a message as delivered and return True if no interceptor wants its key; if False, it must be fed."""
        route = self._routes.get(message.key) or self.route(message.key)
        if route.stages:
            return False
        if not self._running:
            self.start()
        if self._origin is None:
            self._origin = message.time
        route.counts.seen += 1
        route.counts.delivered += 1
        return True

    def run(
        self,
        route: Route,
        time: int,
        *,
        message: Message | None = None,
        arrival: Arrival | None = None,
        segment: str = "",
        targets: tuple[str, ...] = (),
    ) -> Event:
        """Run one message; `result` evaluates the event.

        An undecoded message comes as `arrival`, and is decoded only on demand.

        Raises:
            AbandonedError: `abandon` was called meanwhile.
        """
        if not self._running:
            self.start()
        if self._origin is None:
            self._origin = time
        counts = route.counts
        event = Event(
            message,
            route.topic,
            counts.seen - route.first,
            (time - self._origin) / 1e9,
            arrival,
            segment,
            targets,
            route.kind,
            self._registry,
            provenance=self.provenance,
        )
        counts.seen += 1
        self._fed = route
        if route.stages:
            self._run(event, route, 0)
        return event

    def _run(self, event: Event, route: Route, first: int) -> None:
        stages = route.stages
        for number in range(first, len(stages)):
            stage, wanted = stages[number]
            if stage.bypassed is not None:
                continue
            target = stage.target
            if target is not None and event.targets:
                if target not in event.targets:
                    continue
                if len(event.targets) > 1:
                    branch = event.branch(target)
                    self._run(branch, route, number)
                    continue
            event.interceptor, event.seed = stage.name, stage.when.seed
            state, targets, branches = event.snapshot(), event.targets, event.branches
            self.current = token = [stage]
            failure: BaseException | None = None
            try:
                if wanted is always or wanted(event):
                    stage.message(event)
                    check(event)
                    if event.targets is not targets or event.branches is not branches:
                        raise TypeError("where a message goes cannot be set; conditions of the interceptor can say it")
            except BaseException as error:  # `exit()` or a cancelled task ends an interceptor, not the router
                if isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
                    raise  # Ctrl-C while a log is processed
                failure = error
            self._come_back(token, stage)
            if failure is not None:
                event.restore(state)
                event.targets, event.branches = targets, branches
                self._failed(stage, failure)
            if event.dropped:
                break

    def outcome(self, event: Event, route: Route) -> Result | None:
        """Count and return the result; None if the message goes to all targets at once with at most a new payload."""
        if (
            event.dropped
            or event.added
            or event.branches
            or event.delay_ns > 0
            or event.copies > 0
            or (event.touched and event.new_payload is None)
        ):
            return self.result(event, route)
        route.counts.delivered += 1
        route.counts.changed += event.touched
        return None

    def result(self, event: Event, route: Route) -> Result:
        """Return what becomes of a message, and count it."""
        counts, original = route.counts, event.original
        emissions = self._emissions(event, counts, original, narrow=bool(event.branches))
        changes = tuple(event.changes)
        for branch in event.branches:
            counts.copies += 1
            emissions += self._emissions(branch, counts, original, narrow=True)
            changes += tuple(branch.changes)
        return Result(original, tuple(emissions), changes, event.dropped and not event.branches)

    def _emissions(self, event: Event, counts: Counts, original: Message, *, narrow: bool) -> list[Emission]:
        changes = tuple(event.changes)
        delay, copies = max(0, event.delay_ns), max(0, event.copies)
        targets = event.targets if narrow else None
        emissions: list[Emission] = []
        if event.dropped:
            counts.dropped += 1
        else:
            counts.changed += event.touched
            counts.delayed += delay > 0
            counts.copies += copies
            counts.delivered += 1 + copies
            emissions = [Emission(original.time + delay, event.message, original, changes, targets)] * (1 + copies)
        for message, offset in event.added:
            other = self._count(self._registry.topic(message.key))
            other.added += 1
            other.delivered += 1
            emissions.append(Emission(original.time + max(0, offset), message, None, changes, targets))
        return emissions

    def rewriter(self, key: str, payload: bytes) -> Callable[[bytes], bytes] | None:
        """Return one function for all interceptors, if they only rewrite the payloads of messages of a key.

        An interceptor declares this with a method `rewriter(kind, key, payload)`, which gets the message type (or
        None) and a payload as an example, and returns a pure function or None. Such messages need no events; the
        caller of the function reports them with `rewrote`. Where the function raises PayloadError, the message has to
        be fed instead.
        """
        if self.provenance or not self._running:
            return None
        route = self.route(key)
        functions: list[Callable[[bytes], bytes]] = []
        for stage, decide in route.stages:
            make = stage.hook("rewriter") if decide is always and stage.target is None else None
            function: Any = make(route.kind, key, payload) if make is not None and stage.bypassed is None else None
            if not callable(function):
                return None
            functions.append(function)
        return _composed(functions) if functions else None

    def rewrote(self, key: str, count: int) -> None:
        """Count messages that were changed by what `rewriter` returned."""
        route = self.route(key)
        route.counts.seen += count
        route.counts.changed += count
        route.counts.delivered += count
        for stage, _ in route.stages:
            note = stage.hook("rewrote")
            if note is not None:
                note(key, count)

    def start(self) -> None:
        """Call every interceptor's `start`, unless that was done; raises AbandonedError as `replace`."""
        for stage in self.stages:
            new = id(stage.interceptor) not in self._started
            self._started[id(stage.interceptor)] = stage
            if new:
                self.call(stage, "start")
        self._running = True

    def close(self) -> None:
        """Call every interceptor's `stop`; safe to call twice; raises AbandonedError as `replace`."""
        self._running = False
        self._stop()

    def _stop(self, keep: Container[int] = ()) -> None:
        for number, stage in list(self._started.items()):
            if number not in keep:
                del self._started[number]
                self.call(stage, "stop")

    def call(self, stage: Stage, hook: str, *arguments: object) -> None:
        """Call an optional method of an interceptor, such as `joined`, unless it is bypassed.

        Raises:
            AbandonedError: `abandon` was called meanwhile.
        """
        method = stage.hook(hook)
        if method is None or stage.bypassed is not None:
            return
        self._fed, self.current = None, (token := [stage])
        failure: BaseException | None = None
        try:
            method(*arguments)
        except (Exception, SystemExit) as error:
            failure = error
        self._come_back(token, stage)
        if failure is not None:
            self._failed(stage, failure)

    def abandon(self, asked: list[Stage], reason: str, place: str) -> bool:
        """Give up on the interceptor that is being called: it is bypassed from now on and loses its message.

        The caller that waits for it in `run` gets `AbandonedError` when it returns, and may feed the message again.

        Return whether it was still being called: if not, nothing was done. `asked` is the value of `current` when the
        waiting began, and `place` the line in which it hangs, as `file:line`.
        """
        try:
            stage = asked.pop()
        except IndexError:
            return False
        stage.bypassed = reason
        if self._fed is not None:
            self._fed.counts.seen -= 1  # the message will be fed again
        self._note(stage.name, f"{place}: {reason}", place)
        return True

    def route(self, key: str) -> Route:
        """Return the route of the messages of a key."""
        route = self._routes.get(key)
        if route is None:
            topic = self._registry.topic(key)
            deciders = [(stage, stage.for_key(key, self._registry)) for stage in self.stages]
            stages = tuple((stage, decide) for stage, decide in deciders if decide is not None)
            kind = self._registry.type_of(key) if stages else None
            route = Route(topic, self._count(topic), stages, kind, self._before.get(topic, 0))
            if len(self._routes) >= CACHED_KEYS:
                self._routes.clear()
            self._routes[key] = route
        return route

    def forget(self) -> None:
        """Discard all routes, because a type has become known."""
        self._routes.clear()

    def restart(self) -> None:
        """Restart the time and the message numbers at the next message; counts are kept."""
        self._origin = None
        self._before = {topic: counts.seen for topic, counts in self.counts.items()}
        self._routes.clear()

    def _count(self, topic: str) -> Counts:
        counts = self.counts.get(topic)
        if counts is None:
            if len(self.counts) >= MOST_TOPICS:
                topic = OTHER_TOPICS
            counts = self.counts.setdefault(topic, Counts())
        return counts

    def _come_back(self, token: list[Stage], stage: Stage) -> None:
        try:
            token.pop()  # atomic: either we come back in time, or `abandon` took it
        except IndexError:
            raise AbandonedError(f"interceptor {stage.name} came back too late") from None

    def _failed(self, stage: Stage, error: BaseException) -> None:
        self._note(stage.name, "".join(traceback.format_exception(error)), stage.place(error))

    def _note(self, name: str, text: str, place: str) -> None:
        errors = self.errors.get(name)
        if errors is None:
            self.errors[name] = InterceptorErrors(1, text, place)
        else:
            errors.count += 1
            errors.place = place


def _composed(functions: Sequence[Callable[[bytes], bytes]]) -> Callable[[bytes], bytes]:
    if len(functions) == 1:
        return functions[0]

    def all_of_them(payload: bytes) -> bytes:
        for function in functions:
            payload = function(payload)
        return payload

    return all_of_them
