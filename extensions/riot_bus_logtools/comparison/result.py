"""The result of a comparison of two logs, as plain data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import DataLossError, InconclusiveError
from riot_bus_logtools.comparison.text import rest_lines, topic_lines

if TYPE_CHECKING:
    from riot_bus_logtools.comparison.parts import TopicDifference


@dataclass(frozen=True, slots=True)
class OrderDifference:
    """The order of messages of different topics.

    Attributes:
        total: Messages that both logs have, of all topics.
        moved: Smallest number of them that have to be moved for all to be in the same order.
        counts: Whether another order counts as a difference.
    """

    total: int
    moved: int
    counts: bool = False


@dataclass(frozen=True, slots=True)
class ComparedLog:
    """One of the logs.

    Attributes:
        name: Name of the log shown to users.
        messages: Number of messages that were compared.
        missing: Parts that could not be read, or were lost during recording; a line each.
    """

    name: str
    messages: int
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LogDifference:
    """The differences between two logs.

    Attributes:
        a: The expected log.
        b: The log that is compared with it.
        topics: All topics that were compared, those that differ first.
        ignored: Topics that were not compared, as requested.
        notes: Further remarks, a line each.
    """

    a: ComparedLog
    b: ComparedLog
    topics: tuple[TopicDifference, ...]
    order: OrderDifference
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def compared(self) -> int:
        """Number of messages that both logs have and that were compared."""
        return sum(each.equal + each.changed + each.moved for each in self.topics)

    @property
    def comparable(self) -> bool:
        """Whether any topic has messages in both logs."""
        return any(each.count_a and each.count_b for each in self.topics)

    @property
    def same(self) -> bool:
        """Whether the system has behaved the same; false if there was nothing to compare."""
        return (
            self.comparable and all(each.same for each in self.topics) and not (self.order.counts and self.order.moved)
        )

    @property
    def missing(self) -> tuple[str, ...]:
        """The missing parts of the logs, a line each."""
        return tuple(f"{side.name}: {line}" for side in (self.a, self.b) for line in side.missing)

    def check_compared(self) -> None:
        """Raise InconclusiveError if no topic has messages in both logs."""
        if not self.comparable:
            names = f"{self.a.name}, {self.b.name}"
            hint = "they have no topic in common, or no message; riot info LOG lists what a log has"
            raise InconclusiveError("nothing could be compared", where=names, hint=hint)

    def check_whole(self) -> None:
        """Raise DataLossError if both are the same, but only as far as they could be read."""
        if self.same and self.missing:
            raise DataLossError(f"the same as far as they can be read; missing is {'; '.join(self.missing)}")

    def lines(self) -> Iterator[str]:
        """Yield the result as lines of text, differences first."""
        yield self.headline()
        for topic in self.topics:
            yield from topic_lines(topic)
        yield from rest_lines(self.topics)
        if self.ignored:
            yield f"topics not compared: {', '.join(self.ignored)}"
        if self.order.moved:
            yield f"order across topics: {self.order.moved} of {counted(self.order.total, 'message')} in another one"
        yield from (f"missing: {line}" for line in self.missing)
        yield from (f"note: {line}" for line in self.notes)

    def headline(self) -> str:
        """Return the answer in one line."""
        names, topics = f"{self.a.name} and {self.b.name}", counted(len(self.topics), "topic")
        differing = sum(not each.same for each in self.topics)
        if not self.comparable:
            return f"{names}: nothing could be compared"
        if differing:
            return f"{names} differ in {differing} of {topics}"
        if not self.same:
            return f"{names} differ in the order across topics"
        return f"{names} are the same: {counted(self.compared, 'message')} of {topics}"

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values; bytes are hex text, and numbers that JSON lacks are text."""
        document: dict[str, Any] = _json(asdict(self))
        topics = [{**row, "same": each.same} for row, each in zip(document["topics"], self.topics, strict=True)]
        return {"version": 1, "same": self.same, "compared": self.compared, **document, "topics": topics}


def _json(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _json(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_json(each) for each in value]
    if isinstance(value, bytes):
        return value.hex()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
