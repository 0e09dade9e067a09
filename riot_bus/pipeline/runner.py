"""Run messages through interceptors, sans-I/O: one message in, messages with due times out.

The same pipeline runs on the live bus, over a log and in property tests. It keeps no clock: time is the message's.
A `Pipeline` is not thread-safe; whoever feeds it, feeds it from one thread.
"""

from __future__ import annotations

import traceback
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError
from riot_bus.pipeline.event import Change, Event
from riot_bus.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.message import Message
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Counts", "Emission", "InterceptorErrors", "Pipeline", "Result"]


@dataclass(frozen=True, slots=True)
class Emission:
    """One message to deliver at `due` (nanoseconds); `original` is None for a message that an interceptor added."""

    due: int
    message: Message
    original: Message | None
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one message: a dropped one has no emission of its own, yet its changes say why."""

    original: Message
    emissions: tuple[Emission, ...]
    changes: tuple[Change, ...] = ()
    dropped: bool = False


@dataclass(slots=True)
class Counts:
    """What happened to one topic's messages: `delivered == seen - dropped + copies + added`."""

    seen: int = 0
    changed: int = 0
    dropped: int = 0
    delayed: int = 0
    copies: int = 0
    added: int = 0
    delivered: int = 0


@dataclass(slots=True)
class InterceptorErrors:
    """How often one interceptor raised, and the first traceback."""

    count: int
    first: str


@dataclass(frozen=True, slots=True)
class _Stage:
    name: str
    expressions: tuple[str, ...] | None
    message: Callable[[Event], None]


class _LazyEvent(Event):
    """An event that looks its type up when somebody asks for it."""

    __slots__ = ("_known", "_types")

    def __init__(self, message: Message, topic: str, index: int, seconds: float, types: TypeRegistry) -> None:
        self._types: TypeRegistry | None = types
        self._known: MessageType | None = None
        super().__init__(message, topic, index, seconds)

    @property
    def type(self) -> MessageType | None:
        if self._known is None and self._types is not None:
            message = self.message
            self._known = self._types.type_of(message.key, payload=message.payload, encoding=message.encoding)
            self._types = None
        return self._known

    @type.setter
    def type(self, value: MessageType | None) -> None:
        self._known = value


class Pipeline:
    """Interceptors in a row.

    An interceptor has `message(event)` and may have `name`, `topics` (selectors or key expressions that it wants,
    default all), `load(registry)` (called here; may raise ConfigError), `start()` (before the first message) and
    `stop()` (by `close`). One that raises is isolated: the message goes on as it was before that interceptor, and the
    error is counted in `errors`. Messages that an interceptor adds are delivered as they are.

    Args:
        interceptors: Carried out in this order; a dropped message does not reach the later ones.
        registry: Names topics and knows their types.
        start: Time zero of `Event.seconds`; default is the first message's time.

    Raises:
        ConfigError: An object has no `message` method, or its `load` refuses.
    """

    def __init__(self, interceptors: Sequence[object], *, registry: TypeRegistry, start: int | None = None) -> None:
        self.errors: dict[str, InterceptorErrors] = {}
        self.counts: dict[str, Counts] = {}
        self._registry = registry
        self._origin = start
        self._running = False
        self._interceptors = tuple(interceptors)
        self._stages = _stages(self._interceptors)
        self._routes: dict[str, tuple[str, tuple[_Stage, ...]]] = {}
        for interceptor in self._interceptors:
            load = getattr(interceptor, "load", None)
            if callable(load):
                load(registry)

    def feed(self, message: Message) -> Result:
        """Run one message through all interceptors that want it."""
        if not self._running:
            self._running = True
            self._call_all("start")
        if self._origin is None:
            self._origin = message.time
        topic, stages = self._routes.get(message.key) or self._route(message.key)
        counts = self._count(topic)
        index = counts.seen
        counts.seen += 1
        if not stages:
            counts.delivered += 1
            return Result(message, (Emission(message.time, message, message),))
        event = _LazyEvent(message, topic, index, (message.time - self._origin) / 1e9, self._registry)
        for stage in stages:
            self._run(stage, event)
            if event.dropped:
                break
        return self._result(message, event, counts)

    def close(self) -> None:
        """Call every interceptor's `stop`; safe to call twice."""
        if self._running:
            self._running = False
            self._call_all("stop")

    def _run(self, stage: _Stage, event: Event) -> None:
        before = (event.message, event.dropped, event.delay_ns, event.copies)
        added, changes = len(event.added), len(event.changes)
        event.interceptor = stage.name
        try:
            stage.message(event)
        except Exception:
            event.message, event.dropped, event.delay_ns, event.copies = before
            del event.added[added:], event.changes[changes:]
            self._failed(stage.name)
        else:
            if event.message is not before[0] and len(event.changes) == changes:
                event.changes.append(Change(stage.name, "replace"))

    def _result(self, original: Message, event: Event, counts: Counts) -> Result:
        changes = tuple(event.changes)
        delay, copies = max(0, event.delay_ns), max(0, event.copies)
        emissions: list[Emission] = []
        if event.dropped:
            counts.dropped += 1
        else:
            counts.changed += event.message is not original
            counts.delayed += delay > 0
            counts.copies += copies
            counts.delivered += 1 + copies
            emissions = [Emission(original.time + delay, event.message, original, changes)] * (1 + copies)
        for message, offset in event.added:
            other = self._count(self._registry.topic(message.key))
            other.added += 1
            other.delivered += 1
            emissions.append(Emission(original.time + max(0, offset), message, None, changes))
        return Result(original, tuple(emissions), changes, event.dropped)

    def _route(self, key: str) -> tuple[str, tuple[_Stage, ...]]:
        wanted = tuple(
            stage
            for stage in self._stages
            if stage.expressions is None or any(self._registry.matches(text, key) for text in stage.expressions)
        )
        self._routes[key] = route = (self._registry.topic(key), wanted)
        return route

    def _count(self, topic: str) -> Counts:
        counts = self.counts.get(topic)
        if counts is None:
            counts = self.counts[topic] = Counts()
        return counts

    def _call_all(self, hook: str) -> None:
        for interceptor, stage in zip(self._interceptors, self._stages, strict=True):
            method = getattr(interceptor, hook, None)
            if callable(method):
                try:
                    method()
                except Exception:
                    self._failed(stage.name)

    def _failed(self, name: str) -> None:
        errors = self.errors.get(name)
        if errors is None:
            self.errors[name] = InterceptorErrors(1, traceback.format_exc())
        else:
            errors.count += 1


def _stages(interceptors: Sequence[object]) -> tuple[_Stage, ...]:
    stages = []
    used: Counter[str] = Counter()
    for interceptor in interceptors:
        name = str(getattr(interceptor, "name", None) or type(interceptor).__name__)
        message = getattr(interceptor, "message", None)
        if not callable(message):
            hint = "add one; it is all that it needs"
            raise ConfigError(f"interceptor {name} has no method message(event)", hint=hint)
        used[name] += 1
        if used[name] > 1:
            name = f"{name}#{used[name]}"
        topics = getattr(interceptor, "topics", None)
        if isinstance(topics, str):
            topics = [topics]
        expressions = None if topics is None else tuple(parse_selector(text).topic for text in topics)
        stages.append(_Stage(name, expressions, message))
    return tuple(stages)
