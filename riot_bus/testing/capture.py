"""What crosses a router while a test runs: kept in memory for the test, and in a log for whoever has to mend it."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.types.elements import read_elements, read_field
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.elements import quantity_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.layout import Role
    from riot_bus.log.writer import LogWriter
    from riot_bus.pipeline.event import Change
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

__all__ = ["Capture", "Captured"]

_MOST_BYTES = 256 << 20
_OVERHEAD = 500
"""Bytes of a message in memory besides its payload, about."""

_NAMED = 8


@dataclass(frozen=True, slots=True)
class Captured:
    """A message that has crossed the router.

    Attributes:
        message: As a component has sent it, or as it was delivered.
        changes: What interceptors did to it.
    """

    message: Message
    changes: tuple[Change, ...]
    registry: TypeRegistry

    @property
    def payload(self) -> bytes:
        """Its payload."""
        return self.message.payload

    def read(self, path: str) -> Any:
        """Return a field's value; of a path with `[*]`, all elements.

        Raises:
            ConfigError: Nothing tells the type of the message.
            PayloadError: The message has no such field.
        """
        message = self.message
        kind = self.registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
        if kind is None:
            hint = "say it in the ini option riot_types: TOPIC=TYPE"
            raise ConfigError("nothing tells the type of these messages", where=message.key, hint=hint)
        if "[*]" in path and quantity_of(path) is None:
            return read_elements(kind, message.payload, path)
        return read_field(kind, message.payload, path)


class Capture:
    """Keeps what a `Recorder` is told; its writer.

    Args:
        registry: Names topics and knows their types.
        log: Writes it to a file as well; closed with this.
        most_bytes: Memory for messages, about; of more, the oldest are forgotten (the log has them).
    """

    def __init__(self, registry: TypeRegistry, log: LogWriter | None = None, *, most_bytes: int = _MOST_BYTES) -> None:
        self.forgotten = 0
        """Messages that were given up for lack of room."""
        self._registry = registry
        self._log = log
        self._kept: deque[tuple[Role, Captured]] = deque()
        self._most, self._bytes = most_bytes, 0
        self._arrived = threading.Condition()

    def delivered(self, selector: str) -> list[Captured]:
        """Return what was delivered, in order.

        Args:
            selector: A topic, key expression or `TOPIC where PREDICATE`.

        Raises:
            ConfigError: It is none, or names a field.
        """
        return self._chosen(selector, lambda role, one: role == "delivered")

    def sent(self, selector: str) -> list[Captured]:
        """Return what components have sent, as it was before interceptors had it; see `delivered`."""
        return self._chosen(selector, lambda role, one: role == "original" or not one.changes)

    def wait_for(self, selector: str, count: int = 1, *, timeout: float = 10.0) -> list[Captured]:
        """Wait until so many messages have been delivered since the test began; return all that have.

        Args:
            selector: As for `delivered`.
            count: Number of messages.
            timeout: Seconds.

        Raises:
            AssertionError: They have not come in time; it says what has come instead.
        """
        __tracebackhide__ = True
        deadline = time.monotonic() + timeout
        with self._arrived:
            while len(found := self.delivered(selector)) < count:
                left = deadline - time.monotonic()
                if left <= 0:
                    raise AssertionError(
                        f"{len(found)} of {counted(count, 'message')} of {selector} within {timeout:g} s; "
                        f"delivered: {self._summary() or 'nothing'}"
                    )
                self._arrived.wait(left)
        return found

    async def arrived(self, selector: str, count: int = 1, *, timeout: float = 10.0) -> list[Captured]:
        """Do as `wait_for` while an event loop goes on (asyncio)."""
        return await asyncio.to_thread(self.wait_for, selector, count, timeout=timeout)

    def forget(self) -> None:
        """Give the memory back."""
        with self._arrived:
            self._kept.clear()
            self._bytes = 0

    def _chosen(self, selector: str, wanted: Callable[[Role, Captured], bool]) -> list[Captured]:
        chosen = parse_selector(selector)
        if chosen.field is not None:
            hint = f"write {chosen.topic!r} here, and read('{chosen.field}') of what it returns"
            raise ConfigError("messages are chosen by topic, not by field", where=selector, hint=hint)
        holds = None if chosen.where is None else parse_predicate(chosen.where)
        with self._arrived:
            kept = list(self._kept)
        return [
            one
            for role, one in kept
            if wanted(role, one)
            and self._registry.matches(chosen.topic, one.message.key)
            and (holds is None or holds(one.read))
        ]

    def _summary(self) -> str:
        topics = Counter(self._registry.topic(one.message.key) for role, one in self._kept if role == "delivered")
        named = [f"{topic} {number}" for topic, number in topics.most_common(_NAMED)]
        return ", ".join(named) + (", ..." if len(topics) > _NAMED else "")

    # -- what a recorder's writer has to be ---------------------------------------------------------------------------

    @property
    def problem(self) -> str:
        """Why the log cannot be written at present; empty if all is well."""
        return "" if self._log is None else self._log.problem

    @property
    def refused(self) -> int:
        """Messages that the log cannot hold."""
        return 0 if self._log is None else self._log.refused

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Keep one message."""
        if self._log is not None:
            self._log.write(message, role=role, changes=changes)
        with self._arrived:
            self._kept.append((role, Captured(message, tuple(changes), self._registry)))
            self._bytes += len(message.payload) + _OVERHEAD
            while self._bytes > self._most:
                _, oldest = self._kept.popleft()
                self._bytes -= len(oldest.payload) + _OVERHEAD
                self.forgotten += 1
            self._arrived.notify_all()

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write something that is no message into the log."""
        if self._log is not None:
            self._log.note(name, mapping)

    def renew(self, key: str) -> None:
        """Write further messages of a key with what is known of it now."""
        if self._log is not None:
            self._log.renew(key)

    def tick(self) -> None:
        """Make what was written readable, if it is time."""
        if self._log is not None:
            self._log.tick()

    def flush(self) -> None:
        """Return when all that was written is in the file, or known to be lost."""
        if self._log is not None:
            self._log.flush()

    def close(self) -> None:
        """Finish the file."""
        if self._log is not None:
            self._log.close()
