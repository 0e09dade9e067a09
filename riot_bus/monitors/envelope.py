"""What the messages of one topic were like in nominal trials: bounds, order and norms of their fields, in one pass."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from riot_bus.monitors.forging import with_value
from riot_bus.monitors.model import why_no_message
from riot_bus.monitors.selection import message_selector, selected
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.selector import Selector
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.types.model import MessageType

__all__ = ["Bounds", "Envelope", "Numbers", "norms_of", "numbers_of"]

Bounds = tuple[float | None, float | None]
Numbers = list[tuple[str, str, float]]
"""Path with `[*]` for all elements of an array, path, and value."""

_MOST_ELEMENTS = 64
_OVERTAKEN = 3
_INDEX = re.compile(r"\[\d+\]")
_MEMBERS = ("x", "y", "z", "w")
_Positive = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Envelope:
    """The fields of a topic's messages are as in nominal trials; at most one violation a trial, the first.

    Attributes:
        topic: Topic name or key expression.
        bounds: Smallest and largest value by path, None for no bound; never NaN or infinite. `ranges[*]` stands for the
            first 64 elements.
        increasing: Paths of fields that never decrease, but for a message that up to three others have overtaken.
        norms: Length of vectors and quaternions, and how far from it they may be, by path of what has x, y, z (and w).
    """

    topic: str
    bounds: Mapping[str, Bounds] = field(default_factory=dict)
    increasing: tuple[str, ...] = ()
    norms: Mapping[str, tuple[_Positive, _Positive]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        message_selector(self.topic)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topic."""
        return (self.topic,)

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first message that is different."""
        last: dict[str, deque[float]] = {}
        for message, kind in selected(view, Selector(self.topic)):
            try:
                numbers = numbers_of(kind, message.payload)
            except PayloadError as error:
                return [self._violation("", "cannot be read", str(error))]
            for name, what, detail in self._wrong(numbers, last):
                return [self._violation(name, what, detail)]
        return []

    def unseen(self, view: TrialView) -> str | None:
        """Return that no message came, None if one did."""
        return why_no_message(view, self.topic)

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with a value out of bounds, or with a message that cannot be read if there are no bounds."""
        for name, (low, high) in self.bounds.items():
            if "len(" in name:
                continue
            beyond = [value for bound in (low, high) if bound is not None for value in (bound * 2 - 1, bound * 2 + 1)]
            selector = Selector(self.topic, name.replace("[*]", "[0]"))
            return with_value(view, selector, [math.nan, *beyond, *map(round, beyond)], lambda it: True)
        outputs = [each.with_payload(b"\xff") for each in view.outputs if view.registry.matches(self.topic, each.key)]
        return replace(view, outputs=[*view.outputs, *outputs[:1]])

    def _wrong(self, numbers: Numbers, last: dict[str, deque[float]]) -> Iterator[tuple[str, str, str]]:
        for name, path, value in numbers:
            bounds = self.bounds.get(name)
            if bounds is not None:
                low, high = bounds
                if not math.isfinite(value):
                    yield name, "not finite", f"{path} = {value!r}"
                elif (low is not None and value < low) or (high is not None and value > high):
                    allowed = f"[{'-inf' if low is None else f'{low:g}'}, {'inf' if high is None else f'{high:g}'}]"
                    yield name, "out of bounds", f"{path} = {value!r} is outside {allowed}"
            if path in self.increasing:
                before = last.setdefault(path, deque(maxlen=_OVERTAKEN + 1))
                if len(before) > _OVERTAKEN and value < min(before):
                    yield path, "decreases", f"{path} = {value!r} after {before[-1]!r}"
                before.append(value)
        for parent, (length, _) in norms_of(numbers).items() if self.norms else ():
            wanted, tolerance = self.norms.get(parent, (length, 0.0))
            if not abs(length - wanted) <= tolerance and parent in self.norms:
                yield parent, "has another norm", f"norm of {parent} = {length:g}, nominally {wanted:g}"

    def _violation(self, name: str, what: str, detail: str) -> Violation:
        place = f"{self.topic}:{name}" if name else self.topic
        return Violation("envelope", self.topic, f"envelope: {place} {what}", detail)


def numbers_of(kind: MessageType, payload: bytes) -> Numbers:
    """Return the numbers in a payload, and the lengths of its arrays; raises PayloadError if it is opaque."""
    leaves = kind.leaves(payload, elements=_MOST_ELEMENTS)
    return [
        (_INDEX.sub("[*]", leaf.path), leaf.path, float(leaf.value))
        for leaf in leaves
        if isinstance(leaf.value, int | float)
    ]


def norms_of(numbers: Numbers) -> dict[str, tuple[float, bool]]:
    """Return the length of each vector with members x, y, z, and whether it has w as well, by its path."""
    members: dict[str, dict[str, float]] = {}
    for _, path, value in numbers:
        parent, dot, member = path.rpartition(".")
        if dot and member in _MEMBERS:
            members.setdefault(parent, {})[member] = value
    return {
        parent: (math.hypot(*found.values()), len(found) == 4)
        for parent, found in members.items()
        if found.keys() >= {"x", "y", "z"}
    }
