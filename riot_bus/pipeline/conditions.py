"""Conditions on messages: which ones, on which route, in which period, and what share of them.

`When` says so for a whole interceptor, `Injection` for one fault of a plan; `decider` makes one function of either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.predicate import Predicate


@dataclass(frozen=True, slots=True)
class When:
    """Conditions; all must hold.

    Attributes:
        select: Selectors, of which one must match; None for every message.
        source: Segment that the message comes from.
        target: Segment that the message goes to; if it goes to several, the others get it unchanged.
        start: Earliest time, seconds since the first message that the pipeline saw.
        end: Latest time (exclusive), seconds.
        first: Number of the first message within its topic.
        last: Number of the last message (inclusive).
        where: Predicate on the message's fields; a message without them is left alone.
        probability: Share of the messages, chosen by seed, content and number of the message in its topic.
        seed: Seed of that choice, and of `Event.draw`.
    """

    select: str | tuple[str, ...] | None = None
    source: str | None = None
    target: str | None = None
    start: float = 0.0
    end: float | None = None
    first: int = 0
    last: int | None = None
    where: str | None = None
    probability: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.probability <= 1:
            raise ConfigError(f"probability = {self.probability} is not between 0 and 1")
        if math.isnan(self.start) or (self.end is not None and math.isnan(self.end)):
            raise ConfigError(f"start = {self.start} and end = {self.end} must be times", hint="give seconds")
        if problem := window_problem(self.start, self.end, self.first, self.last):
            raise ConfigError(problem)
        if self.where is not None:
            parse_predicate(self.where)
        self.selectors()

    def selectors(self) -> tuple[tuple[str, str | None], ...] | None:
        """Return topic expression and predicate of each selector, None for every message.

        Raises:
            ConfigError: A selector does not parse, or names a field.
        """
        if self.select is None:
            return None
        parsed = [parse_selector(text) for text in ([self.select] if isinstance(self.select, str) else self.select)]
        if not parsed:
            raise ConfigError("select is an empty list", hint="name a topic, or leave it out for every message")
        for each in parsed:
            if each.where is not None:
                parse_predicate(each.where)
            if each.field is not None:
                hint = f"write '{each.topic} where {each.field} > 0', say, or only {each.topic!r}"
                raise ConfigError(f"selector '{each}' chooses a field, not messages", hint=hint)
        return tuple((each.topic, each.where) for each in parsed)

    def for_key(self, key: str, registry: TypeRegistry) -> Callable[[Event], bool] | None:
        """Return a function that decides about the messages of one key; None if none of them is selected."""
        selectors = self.selectors()
        choices: list[Predicate] = []
        if selectors is not None:
            matching = [where for topic, where in selectors if registry.matches(topic, key)]
            if not matching:
                return None
            if None not in matching:
                choices = [parse_predicate(where) for where in matching if where is not None]
        decide = decider(self, choices=choices)
        source = self.source
        if source is None:
            return decide
        return lambda event: event.segment == source and decide(event)


def decider(
    conditions: When | Injection, *, choices: Sequence[Predicate] = (), source: str | None = None, strict: bool = False
) -> Callable[[Event], bool]:
    """Return a function that decides whether a message is in the window, meets the predicate and is drawn.

    Args:
        conditions: Window, predicate and probability; all must hold.
        choices: Further predicates, of which one must hold, too.
        source: Source of the random numbers; see `Event.draw`.
        strict: Whether a predicate raises PayloadError if its fields cannot be read; if not, it does not hold then.
    """
    where = None if conditions.where is None else parse_predicate(conditions.where)
    meets = where if where is None or strict else where.holds
    probability = conditions.probability
    start = conditions.start if conditions.start > 0 else -math.inf  # times are negative when a clock was set back
    end = math.inf if conditions.end is None else conditions.end
    first = conditions.first
    last = math.inf if conditions.last is None else conditions.last
    timed, numbered = start > 0 or end < math.inf, first > 0 or last < math.inf
    if not (timed or numbered or probability < 1.0 or where or choices):
        return always

    def decide(event: Event) -> bool:  # called for each message and condition: the cheap questions come first
        if timed and not start <= event.seconds < end:
            return False
        if numbered and not first <= event.index <= last:
            return False
        if meets is not None and not meets(event.read):
            return False
        if choices and not any(each.holds(event.read) for each in choices):
            return False
        return probability >= 1.0 or event.draw("chosen", source=source) < probability

    return decide


def window_problem(start: float, end: float | None, first: int, last: int | None) -> str | None:
    """Return what is wrong with a window of times and numbers; None if nothing is."""
    if end is not None and end <= start:
        return f"end = {end} is not later than start = {start}"
    if last is not None and last < first:
        return f"last = {last} is before first = {first}"
    return None


def always(event: Event) -> bool:
    """Return True: the decision when there are no conditions."""
    return True


@dataclass(frozen=True, slots=True)
class Selective:
    """An interceptor that is called only under conditions."""

    interceptor: object
    when: When
    name: str | None = None
