"""Things to try, and where in a log they are tried."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.campaign.moves import Moves
    from riot_bus.vocabulary.injection import Injection

__all__ = ["Placed", "Variation", "sets_value"]


@dataclass(frozen=True, slots=True)
class Variation:
    """One thing to try, on messages that are still to be chosen.

    Attributes:
        topic: Topic of the messages.
        injections: Injections into them.
        about: What it changes, such as `topic:field`; variations about the same thing may fail in the same way.
        span: Number of consecutive messages that it takes.
        first: Number of the first of them within the topic; None for any.
        again: Whether it is made of things that have been tried before.
        times: Number of occurrences in a trial.
        most: Most messages that it may change in a trial, so that enlarged messages fit into memory; None for any.
        elements: Paths of array elements that may get the value in place of the injection's own field.
        moves: Moves of a message by its number, used instead of `injections` if `span` is 1.
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

    def fits(self, first: int, messages: int) -> bool:
        """Return whether it can start at message number `first`, in a topic of `messages` messages."""
        single = self.moves if self.span == 1 else None
        return first >= 0 and first + self.span <= messages and (single is None or first in single.numbers)


@dataclass(frozen=True, slots=True)
class Placed:
    """A thing on certain messages of its topic, starting at each of the ascending numbers in `firsts`."""

    item: Variation
    firsts: tuple[int, ...]

    @property
    def injections(self) -> list[Injection]:
        """Injections into these messages; those with a window of time need no message numbers."""
        span, moves = self.item.span, self.item.moves
        if moves is not None and span == 1:
            return [each for at in self.firsts for each in moves.injections(at)]
        return [
            each if each.start or each.end is not None else replace(each, first=at, last=at + span - 1)
            for at in self.firsts
            for each in self.item.injections
        ]


def sets_value(item: Variation) -> bool:
    """Return whether a thing sets the value of a field, not a length."""
    first = item.injections[0]
    return first.fault == "set" and not str(first.field).startswith("len(")
