"""Invariants on outputs, from `[[monitors]]` in riot.toml: range, finite, rate."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.monitors.model import TrialView

__all__ = ["Finite", "Invariant", "Range", "Rate"]


class Invariant(Protocol):
    """A monitor of some topics, which can also judge while things go on.

    Attributes:
        topics: Which.
    """

    topics: tuple[str, ...]

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return what was violated."""
        ...


def _values(view: TrialView, field: str) -> Iterator[float]:
    selector = parse_selector(field)
    for message in view.outputs:
        if message.kind != "put" or not view.registry.matches(selector.topic, message.key):
            continue
        kind = view.registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
        if kind is None or selector.field is None:
            raise PayloadError(f"the type of {message.key!r} is unknown, so {field!r} cannot be watched")
        value = kind.read(message.payload, selector.field)
        if isinstance(value, (bool, int, float)):
            yield float(value)


class Range:
    """A field of an output stays within bounds (NaN does not)."""

    def __init__(self, field: str, *, low: float | None = None, high: float | None = None) -> None:
        self.field = field
        self.topics: tuple[str, ...] = (parse_selector(field).topic,)
        self.low = -math.inf if low is None else low
        self.high = math.inf if high is None else high

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value outside."""
        for value in _values(view, self.field):
            if not self.low <= value <= self.high:
                detail = f"{self.field} = {value!r} is outside [{self.low:g}, {self.high:g}]"
                return [Violation("range", self.field, f"range of {self.field}", detail)]
        return []


class Finite:
    """A field of an output is neither NaN nor infinite."""

    def __init__(self, field: str) -> None:
        self.field = field
        self.topics: tuple[str, ...] = (parse_selector(field).topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first value that is not finite."""
        for value in _values(view, self.field):
            if not math.isfinite(value):
                return [Violation("finite", self.field, f"{self.field} not finite", f"{self.field} = {value!r}")]
        return []


class Rate:
    """An output comes at least every `gap` seconds of wall time, from the first input to the end of watching."""

    def __init__(self, topic: str, *, gap: float) -> None:
        self.topic = topic
        self.topics: tuple[str, ...] = (topic,)
        self.gap = gap

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when the largest gap is too large."""
        times = [message.time for message in view.outputs if view.registry.matches(self.topic, message.key)]
        stamps = [view.begin, *times, view.end]
        widest = max(after - before for before, after in pairwise(stamps)) / 1e9
        if widest <= self.gap:
            return []
        detail = f"no {self.topic} for {widest:.3f} s (allowed: {self.gap:g} s)"
        return [Violation("rate", self.topic, f"rate of {self.topic}", detail)]
