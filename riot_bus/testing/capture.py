"""Messages that cross a router during a test, kept in memory for the test and in a log for debugging."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.types.elements import read_elements, read_field
from riot_bus.vocabulary.elements import quantity_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import Selector, parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.layout import Role
    from riot_bus.log.writer import LogWriter
    from riot_bus.pipeline.event import Change
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_OVERHEAD = 500
"""Approximate memory of a message besides its payload, in bytes."""

_NAMED = 8  # a failed assertion stays a line or two; the most frequent topics tell most


@dataclass(frozen=True, slots=True)
class Captured:
    """A message that has crossed the router.

    Attributes:
        message: The message, as a component sent it or as it was delivered.
        changes: Changes made by interceptors.
        number: Position among all captured messages.
    """

    message: Message
    changes: tuple[Change, ...]
    registry: TypeRegistry
    number: int

    @property
    def payload(self) -> bytes:
        """Payload of the message."""
        return self.message.payload

    def read(self, path: str) -> Any:
        """Return a field's value; for a path with `[*]`, all elements.

        Raises:
            ConfigError: The type of the message is unknown.
            PayloadError: The message has no such field.
        """
        message = self.message
        kind = self.registry.type_of_message(message)
        if kind is None:
            hint = "say it in the ini option riot_types: TOPIC=TYPE"
            raise ConfigError("nothing tells the type of these messages", where=message.key, hint=hint)
        if "[*]" in path and quantity_of(path) is None:
            return read_elements(kind, message.payload, path)
        return read_field(kind, message.payload, path)


class Capture:
    """A writer for a `Recorder` that keeps the messages in memory.

    Args:
        registry: Registry of topic names and message types.
        log: Writer of a log that gets the same messages; closed together with this object.
        most_bytes: Approximate memory for messages; beyond it, the oldest messages of the largest key are forgotten.
    """

    def __init__(self, registry: TypeRegistry, log: LogWriter | None = None, *, most_bytes: int = 256 << 20) -> None:
        self._registry = registry
        self._log = log
        self._kept: defaultdict[str, deque[tuple[Role, Captured]]] = defaultdict(deque)
        self._bytes: Counter[str] = Counter()
        self._forgotten: Counter[str] = Counter()
        self._changed: set[tuple[str, int]] = set()
        self._most, self._total, self._count = most_bytes, 0, 0
        self._arrived = threading.Condition()
        self._listeners: list[Callable[[], object]] = []

    def mark(self) -> int:
        """Return the current position, for `since`, which leaves out everything captured before it."""
        return self._count

    def delivered(self, selector: str, *, since: int = 0) -> list[Captured]:
        """Return the delivered messages, in order.

        Args:
            selector: Topic, key expression or `TOPIC where PREDICATE`; messages without the field do not match.
            since: Position as returned by `mark`.

        Raises:
            ConfigError: The selector is invalid or names a field.
            AssertionError: Messages that may match are no longer in memory.
        """
        return self._chosen(selector, since, lambda role, one: role == "delivered")

    def sent(self, selector: str, *, since: int = 0) -> list[Captured]:
        """Return the messages as components sent them, before interceptors; arguments and errors as in `delivered`."""
        changed = self._changed
        return self._chosen(
            selector,
            since,
            lambda role, one: (
                role == "original" or not (one.changes or (one.message.key, one.message.sequence) in changed)
            ),
        )

    def wait_for(self, selector: str, count: int = 1, *, timeout: float = 10.0, since: int = 0) -> list[Captured]:
        """Wait until `count` messages have been delivered since the test began; return all that have been.

        Args:
            selector: Selector as for `delivered`.
            count: Number of messages.
            timeout: Longest time to wait, in seconds.
            since: Position as returned by `mark`.

        Raises:
            AssertionError: They were not delivered in time; the text says what was delivered instead.
        """
        __tracebackhide__ = True
        deadline = time.monotonic() + timeout
        with self._arrived:
            while len(found := self.delivered(selector, since=since)) < count:
                left = deadline - time.monotonic()
                if left <= 0:
                    raise AssertionError(self._instead(selector, found, count, timeout, since))
                self._arrived.wait(left)
        return found

    async def arrived(self, selector: str, count: int = 1, *, timeout: float = 10.0, since: int = 0) -> list[Captured]:
        """Do the same as `wait_for` without blocking the asyncio event loop."""
        __tracebackhide__ = True
        loop, deadline = asyncio.get_running_loop(), time.monotonic() + timeout
        more = asyncio.Event()

        def told() -> None:
            loop.call_soon_threadsafe(more.set)

        with self._arrived:
            self._listeners.append(told)
        try:
            while len(found := self.delivered(selector, since=since)) < count:
                left = deadline - time.monotonic()
                if left <= 0:
                    raise AssertionError(self._instead(selector, found, count, timeout, since))
                try:
                    await asyncio.wait_for(more.wait(), left)
                except TimeoutError:
                    continue
                more.clear()
        finally:
            with self._arrived:
                self._listeners.remove(told)
        return found

    def forget(self) -> None:
        """Forget all messages to free their memory."""
        with self._arrived:
            self._kept.clear()
            self._bytes.clear()
            self._total = 0

    def _chosen(self, text: str, since: int, wanted: Callable[[Role, Captured], bool]) -> list[Captured]:
        selector = parse_selector(text)
        if selector.field is not None:
            hint = f"write {selector.topic!r} here, and read('{selector.field}') of what it returns"
            raise ConfigError("messages are chosen by topic, not by field", where=text, hint=hint)
        with self._arrived:
            keys = [key for key in self._kept if self._registry.matches(selector.topic, key)]
            gone = {key: number for key in keys if (number := self._forgotten[key])}
            kept = [(role, one) for key in keys for role, one in self._kept[key] if one.number >= since]
        assert not gone, f"messages are not in memory any more, but in the log: {dict(gone)}"
        holds = _condition(selector)
        found = [one for role, one in kept if wanted(role, one) and holds(one)]
        return sorted(found, key=lambda one: one.number) if len(keys) > 1 else found

    def _instead(self, selector: str, found: Sequence[Captured], count: int, timeout: float, since: int) -> str:
        with self._arrived:
            topics = Counter[str]()
            for key, kept in self._kept.items():
                topics[self._registry.topic(key)] += sum(
                    role == "delivered" and one.number >= since for role, one in kept
                )
        named = [f"{topic} {number}" for topic, number in (+topics).most_common(_NAMED)]
        told = ", ".join(named) + (", ..." if len(+topics) > _NAMED else "")
        return f"{len(found)} of {count} messages of {selector} within {timeout:g} s; delivered: {told or 'nothing'}"

    # -- the interface of a recorder's writer -------------------------------------------------------------------------

    @property
    def problem(self) -> str:
        """Reason why the log cannot be written at present; empty if it can."""
        return "" if self._log is None else self._log.problem

    @property
    def refused(self) -> int:
        """Number of messages that the log cannot store."""
        return 0 if self._log is None else self._log.refused

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Keep one message."""
        with self._arrived:
            self._kept[message.key].append((role, Captured(message, tuple(changes), self._registry, self._count)))
            self._count += 1
            if role == "original":
                self._changed.add((message.key, message.sequence))
            self._weigh(message, 1)
            while self._total > self._most:
                key = max(self._bytes, key=self._bytes.__getitem__)
                self._weigh(self._kept[key].popleft()[1].message, -1)
                self._forgotten[key] += 1
            self._arrived.notify_all()
            for told in self._listeners:
                told()
        if self._log is not None:
            self._log.write(message, role=role, changes=changes)

    def _weigh(self, message: Message, sign: int) -> None:
        size = sign * (len(message.payload) + _OVERHEAD)
        self._bytes[message.key] += size
        self._total += size

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write an entry that is not a message into the log."""
        if self._log is not None:
            self._log.note(name, mapping)

    def renew(self, key: str) -> None:
        """Write later messages of a key with what is known about the key now."""
        if self._log is not None:
            self._log.renew(key)

    def tick(self) -> None:
        """Make the messages written so far readable, if that is due."""
        if self._log is not None:
            self._log.tick()

    def flush(self) -> None:
        """Wait until all messages written so far are in the file or known to be lost."""
        if self._log is not None:
            self._log.flush()

    def close(self) -> None:
        """Finish the file."""
        if self._log is not None:
            self._log.close()


def _condition(selector: Selector) -> Callable[[Captured], bool]:
    if selector.where is None:
        return lambda one: True
    predicate = parse_predicate(selector.where)
    return lambda one: predicate.holds(one.read)
