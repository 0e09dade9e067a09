"""Invariants on fields of outputs: range, finite, values, sequence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

from pydantic import Field

from riot_bus.monitors.forging import with_value
from riot_bus.monitors.model import TrialView
from riot_bus.monitors.selection import WithSelectors, field_selector, integers, numbers, why_unseen
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.trial import Violation

_Bound = Annotated[float, Field(allow_inf_nan=False)]


class _OfField(WithSelectors):
    """Base class of monitors of one field."""

    field: str

    selectors = (("field", field_selector),)

    def unseen(self, view: TrialView) -> str | None:
        """Return why there was no number to judge, None if there was one."""
        return why_unseen(view, field_selector(self.field))


@dataclass(frozen=True)
class Range(_OfField):
    """A field of an output stays within bounds (NaN does not).

    Attributes:
        field: `topic:field`.
        min: Smallest value; None for no bound.
        max: Largest value; None for no bound.
    """

    field: str
    min: _Bound | None = None
    max: _Bound | None = None

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value out of bounds."""
        for value in numbers(view, field_selector(self.field)):
            if self._outside(value):
                low, high = self._bounds
                detail = f"{self.field} = {value!r} is outside [{low:g}, {high:g}]"
                return [Violation("range", self.field, f"range of {self.field}", detail)]
        return []

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with a value out of bounds."""
        beyond = [bound + sign * max(1.0, abs(bound)) for bound, sign in zip(self._bounds, (-1, 1), strict=True)]
        whole = [step(value) for value in beyond if math.isfinite(value) for step in (math.floor, math.ceil)]
        return with_value(view, field_selector(self.field), [math.nan, *beyond, *whole], self._outside)

    @property
    def _bounds(self) -> tuple[float, float]:
        return -math.inf if self.min is None else self.min, math.inf if self.max is None else self.max

    def _outside(self, value: Scalar) -> bool:
        low, high = self._bounds
        return isinstance(value, int | float) and not low <= value <= high


@dataclass(frozen=True)
class Finite(_OfField):
    """A field of an output is neither NaN nor infinite.

    Attributes:
        field: `topic:field`.
    """

    field: str

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value that is not finite."""
        for value in numbers(view, field_selector(self.field)):
            if not math.isfinite(value):
                return [Violation("finite", self.field, f"{self.field} not finite", f"{self.field} = {value!r}")]
        return []

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with a value that is not a number."""
        values = (math.nan, math.inf)
        return with_value(view, field_selector(self.field), values, lambda it: isinstance(it, float) and it - it != 0)


@dataclass(frozen=True)
class Values(_OfField):
    """An integer field of an output takes only some values.

    Attributes:
        field: `topic:field`.
        allowed: The values.
        mask: Bits of the field that count; None for all.
    """

    field: str
    allowed: Annotated[tuple[int, ...], Field(min_length=1)]
    mask: int | None = None

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first other value."""
        for value in integers(view, field_selector(self.field)):
            if self._other(value):
                known = ", ".join(map(str, sorted(self.allowed)))
                detail = f"{self.field} = {value}, allowed: {known}" + (f" of bits {self.mask:#x}" if self.mask else "")
                return [Violation("values", self.field, f"values of {self.field}", detail)]
        return []

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with another value."""
        single = (1 << bit for bit in range((self.mask or 0).bit_length()))
        return with_value(view, field_selector(self.field), [*range(256), *single, self.mask or -1], self._other)

    def _other(self, value: Scalar) -> bool:
        return isinstance(value, int) and (value if self.mask is None else value & self.mask) not in self.allowed


@dataclass(frozen=True)
class Gapless(_OfField):
    """A sequence number grows by one from message to message, so that none is lost; it wraps to 0 at `modulo`.

    Attributes:
        field: `topic:field`; a topic with wildcards is one stream.
        modulo: Value at which the number wraps to 0.
        lost: Number of messages that may be missing.
    """

    field: str
    modulo: Annotated[int, Field(ge=2)] = 256
    lost: Annotated[int, Field(ge=0)] = 0

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when too many are missing."""
        found = list(integers(view, field_selector(self.field)))
        missing = self._missing(found)
        if missing <= self.lost:
            return []
        detail = f"{missing} lost, {len(found)} received (allowed: {self.lost})"
        return [Violation("sequence", self.field, f"sequence of {self.field}", detail)]

    def unseen(self, view: TrialView) -> str | None:
        """Return why there were no two numbers, None if there were."""
        absent = super().unseen(view)
        few = absent is None and len(list(integers(view, field_selector(self.field)))) < 2
        return f"only one message of {self.field} came" if few else absent

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with a gap before the last message."""
        found = list(integers(view, field_selector(self.field)))
        values = [(found[-1] + step) % self.modulo for step in range(self.lost + 1, self.lost + self.modulo)]
        selector = field_selector(self.field)
        return with_value(
            view, selector, values, lambda it: isinstance(it, int) and self._missing([*found[:-1], it]) > self.lost
        )

    def _missing(self, numbers: Sequence[int]) -> int:
        return sum((after - before - 1) % self.modulo for before, after in pairwise(numbers))
