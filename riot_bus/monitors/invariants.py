"""Invariants on outputs: range, finite, rate, never, values, sequence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from riot_bus.monitors.selection import field_selector, integers, message_selector, numbers, selected
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.monitors.model import TrialView

__all__ = ["Finite", "Gapless", "Never", "Range", "Rate", "Seconds", "Values"]

Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Bound = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class Range:
    """A field of an output stays within bounds (NaN does not).

    Attributes:
        field: `topic:field`.
        min: Smallest value; None for no bound.
        max: Largest value; None for no bound.
    """

    field: str
    min: _Bound | None = None
    max: _Bound | None = None

    def __post_init__(self) -> None:
        field_selector(self.field)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of the field."""
        return (field_selector(self.field).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value outside."""
        low = -math.inf if self.min is None else self.min
        high = math.inf if self.max is None else self.max
        for value in numbers(view, field_selector(self.field)):
            if not low <= value <= high:
                detail = f"{self.field} = {value!r} is outside [{low:g}, {high:g}]"
                return [Violation("range", self.field, f"range of {self.field}", detail)]
        return []


@dataclass(frozen=True)
class Finite:
    """A field of an output is neither NaN nor infinite.

    Attributes:
        field: `topic:field`.
    """

    field: str

    def __post_init__(self) -> None:
        field_selector(self.field)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of the field."""
        return (field_selector(self.field).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value that is not finite."""
        for value in numbers(view, field_selector(self.field)):
            if not math.isfinite(value):
                return [Violation("finite", self.field, f"{self.field} not finite", f"{self.field} = {value!r}")]
        return []


@dataclass(frozen=True)
class Rate:
    """An output comes at least every `gap` seconds of wall time, from the first input to the end of watching.

    Attributes:
        topic: Topic name or key expression.
        gap: Longest time between two messages, seconds.
    """

    topic: str
    gap: Seconds

    @property
    def topics(self) -> tuple[str, ...]:
        """The topic."""
        return (self.topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when the largest gap is too large."""
        times = [message.time for message in view.outputs if view.registry.matches(self.topic, message.key)]
        stamps = [view.begin, *times, view.end]
        widest = max(after - before for before, after in pairwise(stamps)) / 1e9
        if widest <= self.gap:
            return []
        detail = f"no {self.topic} for {widest:.3f} s (allowed: {self.gap:g} s)"
        return [Violation("rate", self.topic, f"rate of {self.topic}", detail)]


@dataclass(frozen=True)
class Never:
    """No message of an output meets a condition.

    Attributes:
        when: A selector with a predicate, `1/1/STATUSTEXT where severity <= 2`; without one no message may come at all.
        tell: A field of such a message that is told.
    """

    when: str
    tell: str | None = None

    def __post_init__(self) -> None:
        message_selector(self.when)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of the messages."""
        return (message_selector(self.when).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first such message."""
        for message, kind in selected(view, message_selector(self.when)):
            told = "" if self.tell is None else f": {self.tell} = {kind.read(message.payload, self.tell)!r}"
            return [Violation("never", self.topics[0], f"never {self.when}", f"{message.key}{told}")]
        return []


@dataclass(frozen=True)
class Values:
    """An integer field of an output takes only some values.

    Attributes:
        field: `topic:field`.
        allowed: The values.
        mask: Bits of the field that count; None for all.
    """

    field: str
    allowed: Annotated[tuple[int, ...], Field(min_length=1)]
    mask: int | None = None

    def __post_init__(self) -> None:
        field_selector(self.field)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of the field."""
        return (field_selector(self.field).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first other value."""
        for value in integers(view, field_selector(self.field)):
            if (value if self.mask is None else value & self.mask) not in self.allowed:
                known = ", ".join(map(str, sorted(self.allowed)))
                detail = f"{self.field} = {value}, allowed: {known}" + (f" of bits {self.mask:#x}" if self.mask else "")
                return [Violation("values", self.field, f"values of {self.field}", detail)]
        return []


@dataclass(frozen=True)
class Gapless:
    """A sequence number grows by one from message to message, so that none is lost; it begins anew at `modulo`.

    Attributes:
        field: `topic:field`; a topic with wildcards is one stream.
        modulo: The number after the last one is 0.
        lost: So many may be missing.
    """

    field: str
    modulo: Annotated[int, Field(ge=2)] = 256
    lost: Annotated[int, Field(ge=0)] = 0

    def __post_init__(self) -> None:
        field_selector(self.field)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of the field."""
        return (field_selector(self.field).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when too many are missing."""
        found = list(integers(view, field_selector(self.field)))
        missing = sum((after - before - 1) % self.modulo for before, after in pairwise(found))
        if missing <= self.lost:
            return []
        detail = f"{missing} lost, {len(found)} received (allowed: {self.lost})"
        return [Violation("sequence", self.field, f"sequence of {self.field}", detail)]
