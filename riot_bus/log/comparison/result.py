"""What a comparison of two logs has found, as plain data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import DataLossError, InconclusiveError

if TYPE_CHECKING:
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["Example", "FieldDifference", "LogDifference", "OrderDifference", "Side", "Timing", "TopicDifference"]


@dataclass(frozen=True, slots=True)
class Example:
    """One place where a field differs.

    Attributes:
        path: Where in the message.
        a: Number of the message among those of its topic in the first log, from 0.
        b: In the second one.
        seconds: Since the first message of the first log.
        before: Value in the first log; None if the message has no such field.
        after: In the second one.
    """

    path: str
    a: int
    b: int
    seconds: float
    before: Scalar | None
    after: Scalar | None


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """A field that differs in some messages.

    Attributes:
        name: Its path, in which `[*]` stands for any element.
        messages: How many.
        example: Where it differs most; of texts, where it differs first.
        largest: By how much it differs at most; None if that is no number.
        typical: By how much it differs in half of the messages in which it does, likewise.
        low: Least value in either log, likewise.
        high: Greatest value, likewise.
        whole: Whether all of these are whole numbers.
        unlike: Messages in which it is there in one log alone, or no number in one.
    """

    name: str
    messages: int
    example: Example
    largest: float | None = None
    typical: float | None = None
    low: float | None = None
    high: float | None = None
    whole: bool = False
    unlike: int = 0


@dataclass(frozen=True, slots=True)
class Timing:
    """By how many seconds messages of a topic came earlier or later, counted from the first message in common.

    Attributes:
        median: Of all, without sign.
        largest: Of all, without sign.
        number: The message of which that is so, in the first log.
        late: Messages of which it is more than was allowed.
    """

    median: float
    largest: float
    number: int
    late: int = 0


@dataclass(frozen=True, slots=True)
class TopicDifference:
    """One topic in two logs.

    Attributes:
        topic: What people call it.
        type: Name of its type, or what both logs call it where they differ.
        count_a: Messages in the first log.
        count_b: In the second one.
        equal: Messages that are the same in both, in the same order.
        near: How many of those differ within the tolerances.
        changed: Messages in which a field differs.
        lost: Messages of the first log alone.
        added: Of the second log alone.
        moved: Messages that both have, in another order.
        unaligned: Messages of both logs of which nobody can tell which belong together.
        fields: That differ, those in most messages first.
        left: Fields that differ and are not compared: in how many messages, by name.
        same_fields: Messages that have other bytes, but the same fields.
        opaque: Messages that were compared as bytes in both logs, by reason.
        lost_at: Numbers of the first ones.
        added_at: Likewise.
        moved_at: Numbers in both logs, likewise.
        allowed: So many may be lost, added or moved.
        timing: When they came; None without any in common.
        labels: What else both logs say in different ways, such as `encoding`.
        profile: Share of the first log's messages that are changed, lost or moved, along the log; empty if none is.
    """

    topic: str
    type: str
    count_a: int
    count_b: int
    equal: int = 0
    near: int = 0
    changed: int = 0
    lost: int = 0
    added: int = 0
    moved: int = 0
    unaligned: tuple[int, int] = (0, 0)
    fields: tuple[FieldDifference, ...] = ()
    left: Mapping[str, int] = field(default_factory=dict)
    same_fields: int = 0
    opaque: Mapping[str, int] = field(default_factory=dict)
    lost_at: tuple[int, ...] = ()
    added_at: tuple[int, ...] = ()
    moved_at: tuple[tuple[int, int], ...] = ()
    allowed: float = 0.0
    timing: Timing | None = None
    labels: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    profile: tuple[float, ...] = ()

    @property
    def shifted(self) -> int:
        """Messages that are lost, added or in another order."""
        return self.lost + self.added + self.moved

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than is tolerated."""
        late = self.timing.late if self.timing is not None else 0
        return not (self.changed or any(self.unaligned) or late or self.labels) and self.shifted <= self.allowed


@dataclass(frozen=True, slots=True)
class OrderDifference:
    """The order of messages of different topics.

    Attributes:
        total: Messages that both logs have, of all topics.
        moved: The fewest of them that would have to be moved, so that all come in the same order.
        counts: Whether it is a difference.
    """

    total: int
    moved: int
    counts: bool = False


@dataclass(frozen=True, slots=True)
class Side:
    """One of the logs.

    Attributes:
        name: What people call it.
        messages: That were compared.
        missing: What could not be read, or was lost when it was recorded; a line each.
    """

    name: str
    messages: int
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LogDifference:
    """Two logs side by side.

    Attributes:
        a: What was expected.
        b: What came.
        topics: All that were compared, those that differ first.
        order: Across topics.
        ignored: Topics that were not compared, as was wished.
        notes: What else is to be said, a line each.
    """

    a: Side
    b: Side
    topics: tuple[TopicDifference, ...]
    order: OrderDifference
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def compared(self) -> int:
        """Messages that both logs have, of which it is known whether they are the same."""
        return sum(each.equal + each.changed + each.moved for each in self.topics)

    @property
    def same(self) -> bool:
        """Whether the system has answered the same."""
        return all(each.same for each in self.topics) and not (self.order.counts and self.order.moved)

    @property
    def missing(self) -> tuple[str, ...]:
        """What of the logs is missing, a line each."""
        return tuple(f"{side.name}: {line}" for side in (self.a, self.b) for line in side.missing)

    def check(self) -> None:
        """Raise an error if this is no answer, or none for the whole of both logs.

        Raises:
            InconclusiveError: No topic has messages in both.
            DataLossError: They are the same, as far as they could be read.
        """
        if not any(each.count_a and each.count_b for each in self.topics):
            names = f"{self.a.name}, {self.b.name}"
            hint = "they have no topic in common, or no message; riot info LOG lists what a log has"
            raise InconclusiveError("nothing could be compared", where=names, hint=hint)
        if self.same and self.missing:
            raise DataLossError(f"the same as far as they can be read; missing is {'; '.join(self.missing)}")

    def lines(self) -> Iterator[str]:
        """Yield it for people."""
        from riot_bus.log.comparison.text import difference_lines

        return difference_lines(self)

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON values; bytes are hex text, and numbers that JSON lacks are text."""
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
