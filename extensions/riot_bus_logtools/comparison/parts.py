"""The differences of one topic between two logs, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from riot_bus.vocabulary.message import Scalar


@dataclass(frozen=True, slots=True)
class FieldExample:
    """One place where a field differs: numbers of the messages among those of their topic in each log, from 0.

    Seconds count from the first message of the first log; None stands for the value of a message without the field.
    """

    path: str
    a: int
    b: int
    seconds: float
    before: Scalar | None
    after: Scalar | None


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """A field that differs in some messages; numbers are None where values are none.

    Attributes:
        example: Place where it differs most; for texts, where it differs first.
        typical: Median difference of the messages in which it differs; `largest` is the largest one.
        low: Smallest value in either log, `high` the largest one.
        unlike: Messages in which only one log has the field, or in which it is not a number in one log.
        turns: Share of differences that have another sign than the one before: half of them in noise, few in a drift.
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
    turns: float = 0.0


@dataclass(frozen=True, slots=True)
class TopicTiming:
    """Seconds, without sign, by which messages of a topic were earlier or later than the first message in common.

    The number is that of the message with the largest one, in the first log; `late` counts those with too much.
    """

    median: float
    largest: float
    number: int
    late: int = 0


@dataclass(frozen=True, slots=True)
class TopicDifference:
    """One topic in two logs.

    Attributes:
        type: Name of its type in the first log, or in the second one if the first has none.
        near: Number of those that differ within the tolerances.
        lost: Messages of the first log only, `added` those of the second one.
        left: Number of messages by name of each field that differs and is not compared.
        same_fields: Messages that have other bytes, but the same fields.
        opaque: Messages that were compared as bytes in both logs, by reason.
        lost_at: Numbers of the first lost messages; of moved ones, there are those in both logs.
        labels: Other properties that differ between the logs, such as `encoding`.
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
