"""Variations of a log: one change to try, the messages that it is tried on, and moves of single messages in time."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace

from riot_bus.vocabulary.injection import Injection

_LATE = 10
"""Number of later messages of its topic after which a late message comes."""
_OTHERS = 16
"""Most topics that an early message precedes, those with few messages first: on others, the next one follows soon."""
_MARGIN_NS = 50_000_000
"""Largest time by which a message comes after another one, so that a live system sees that order, too."""


@dataclass(frozen=True, slots=True)
class Moves:
    """One way to move messages of a topic.

    Attributes:
        way: Number of later messages of its topic that each comes after; 0 if it comes after the next message of
            another topic; -1 if it comes before the last message that each other topic had until then.
        times: Times of all messages of the log, nanoseconds, ascending.
        positions: For each topic the positions of its messages in the log, ascending.
        numbers: Numbers within the topic of the messages that can be moved this way.
        others: Topics whose messages may be delayed so that one of this topic is early.
    """

    topic: str
    way: int
    times: Sequence[int]
    positions: Mapping[str, Sequence[int]]
    numbers: range
    others: Sequence[str] = ()

    def injections(self, number: int) -> tuple[Injection, ...]:
        """Return the injections that move the topic's message of this number; nothing if it cannot be moved."""
        if number not in self.numbers:
            return ()
        own = self.positions[self.topic]
        if self.way < 0:
            before = {topic: bisect_left(self.positions[topic], own[number]) - 1 for topic in self.others}
            found = [(topic, last) for topic, last in before.items() if last >= 0][:_OTHERS]
            return tuple(self._delayed(topic, last, own[number]) for topic, last in found)
        behind = own[number + self.way] if self.way else self._next_other(number)
        return (self._delayed(self.topic, number, behind),)

    def _next_other(self, number: int) -> int:
        """Return the position of the next message of another topic, which must exist."""
        own, position = self.positions[self.topic], self.positions[self.topic][number]
        while number < len(own) and own[number] == position:
            number, position = number + 1, position + 1
        return position

    def _delayed(self, topic: str, number: int, behind: int) -> Injection:
        """Return the injection that delays a message until right after the one at a position of the log."""
        time = self.times[behind]
        room = self.times[behind + 1] - time if behind + 1 < len(self.times) else 2 * _MARGIN_NS
        due = time + max(1, min(_MARGIN_NS, room // 2))
        delay = max(1, due - self.times[self.positions[topic][number]])
        return Injection(topic, fault="delay", delay=delay / 1e9, first=number, last=number)


def moves_of(
    topic: str, times: Sequence[int], positions: Mapping[str, Sequence[int]], *, still: Container[str] = ()
) -> list[Moves]:
    """Return the ways to move messages of a topic that are possible for at least one of them.

    A message comes after the next one of its topic, after a later one, after the next one of another topic, or before
    the last one of each other topic.

    `times` are those of all messages of the log, nanoseconds, and `positions` those of the messages of each topic, both
    ascending. Messages of the topics in `still` are not delayed.
    """
    own, rest = positions[topic], [name for name in positions if name != topic]
    others = sorted((name for name in rest if name not in still), key=lambda name: len(positions[name]))
    first = min((positions[name][0] for name in others), default=len(times))
    last = max((positions[name][-1] for name in rest), default=-1)
    late = min(_LATE, len(own) - 1)
    ways = {way: range(len(own) - way) for way in (1, late)} if late else {}
    ways |= {0: range(bisect_left(own, last)), -1: range(bisect_left(own, first), len(own))}
    return [Moves(topic, way, times, positions, numbers, others) for way, numbers in ways.items() if numbers]


@dataclass(frozen=True, slots=True)
class Variation:
    """One change to try, on messages that are still to be chosen.

    Attributes:
        injections: Injections into them.
        about: Name of what it changes, such as `topic:field`; variations about the same thing may fail in the same way.
        span: Number of consecutive messages that it takes.
        first: Number of the first of them within the topic; None for any.
        again: Whether it is made of variations that have been tried before.
        times: Number of occurrences in a trial.
        most: Most messages that it may change in a trial, so that enlarged messages fit into memory; None for any.
        elements: Paths of array elements that may get the value in place of the injection's own field.
        moves: Moves of a message by its number, used instead of `injections` if `span` is 1.
        malformed: Whether a sender that works would never send it, such as a payload that is cut off.
    """

    topic: str
    injections: tuple[Injection, ...]
    about: str
    span: int = 1
    first: int | None = None
    again: bool = False
    times: int = 1
    most: int | None = None
    elements: tuple[str, ...] = ()
    moves: Moves | None = field(default=None, compare=False)
    malformed: bool = False

    def with_(self, other: Variation) -> Variation:
        """Return the changes of both as one variation of the same messages."""
        most = min((each.most for each in (self, other) if each.most is not None), default=None)
        about = " and ".join(sorted((self.about, other.about)))
        return replace(self, injections=(*self.injections, *other.injections), about=about, most=most)

    def fits(self, first: int, messages: int) -> bool:
        """Return whether it can start at message number `first`, in a topic of `messages` messages."""
        single = self.moves if self.span == 1 else None
        return first >= 0 and first + self.span <= messages and (single is None or first in single.numbers)


@dataclass(frozen=True, slots=True)
class Placed:
    """A variation on certain messages of its topic, starting at each of the ascending numbers in `firsts`."""

    item: Variation
    firsts: tuple[int, ...]

    @property
    def injections(self) -> list[Injection]:
        """Injections into these messages."""
        span, moves = self.item.span, self.item.moves
        if moves is not None and span == 1:
            return [each for at in self.firsts for each in moves.injections(at)]
        return [replace(each, first=at, last=at + span - 1) for at in self.firsts for each in self.item.injections]


def sets_value(item: Variation) -> bool:
    """Return whether a variation sets the value of a field, not a length."""
    first = item.injections[0]
    return first.fault == "set" and not str(first.field).startswith("len(")
