"""What differs of one topic in two logs, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["FieldDifference", "FieldExample", "TopicDifference", "TopicTiming"]


@dataclass(frozen=True, slots=True)
class FieldExample:
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
        messages: Number of messages in which it differs.
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
    example: FieldExample
    largest: float | None = None
    typical: float | None = None
    low: float | None = None
    high: float | None = None
    whole: bool = False
    unlike: int = 0


@dataclass(frozen=True, slots=True)
class TopicTiming:
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
        added_at: Numbers of the first ones of the second log.
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
    timing: TopicTiming | None = None
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
