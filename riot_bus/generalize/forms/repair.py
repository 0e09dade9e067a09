"""The nearest values for which a rule does not hold, as its thresholds tell."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from riot_bus.generalize.forms.function import compiled, judge_of, term_judges
from riot_bus.generalize.forms.tree import NO_ROOTS, Terms, roots
from riot_bus.generalize.sampling import integer_range

__all__ = ["Repair", "why_not_repairable"]

_STEPS = (0, 1, -1, 2, -2, 4, -4)
"""So many units in the last place from a root its neighbours are tried: what rounding can be off, and a little more."""

_FLOATS = {"float32": (24, -149), "float64": (53, -1074)}


def why_not_repairable(terms: Terms, names: Sequence[str], types: Mapping[str, str]) -> str:
    """Return why a rule has no nearest values for which it does not hold; empty if it has.

    Args:
        terms: Of the rule.
        names: Variables that may be changed.
        types: Of the variables.
    """
    movable = [name for name in names if _is_number(types.get(name, ""))]
    for term in terms:
        if not any(roots(literal, name) for literal in term for name in movable):
            text = " and ".join(literal.text() for literal in term) or "always"
            kinds = [NO_ROOTS[literal.feature.kind] for literal in term if literal.feature.kind in NO_ROOTS]
            return f"{text!r} has no nearest value for which it is false" + (f": {kinds[0]}" if kinds else "")
    return ""


@dataclass(frozen=True, slots=True)
class _Root:
    place: int
    where: Callable[[Sequence[Any]], float]
    threshold: float


class Repair:
    """Changes values so that a rule does not hold: one of them as little as possible, more only where one will not do.

    How far a value moves is measured in units of its scale. Where several have to move, each moves as little as makes
    one more term false.

    Args:
        terms: Of the rule.
        names: Of all values, in their order.
        movable: Those that may be changed.
        types: By name.
        scale: Nominal spread by name; 1 where it is missing.
    """

    def __init__(
        self,
        terms: Terms,
        names: Sequence[str],
        *,
        movable: Sequence[str],
        types: Mapping[str, str],
        scale: Mapping[str, float],
    ) -> None:
        self._judge = judge_of(terms, names)
        self._terms = term_judges(terms, names)
        self._types = [types.get(name, "") for name in names]
        self._units = [scale[name] if scale.get(name, 0) > 0 else 1.0 for name in names]
        literals = dict.fromkeys(literal for term in terms for literal in term)
        self._roots = [
            _Root(names.index(name), compiled(root, names), float(literal.value))
            for literal in literals
            for name in movable
            if _is_number(types.get(name, ""))
            for root in roots(literal, name)
            if isinstance(literal.value, int | float)
        ]

    def __call__(self, values: Sequence[Any]) -> list[Any] | None:
        """Return values for which the rule does not hold; None if there are none to be found.

        Args:
            values: In the order of the names; the rule holds for them.
        """
        now = list(values)
        for _ in self._terms:
            if not self._judge(now):
                return now
            found = self._nearest(now)
            if found is None:
                return None
            now = found
        return None if self._judge(now) else now

    def _nearest(self, values: list[Any]) -> list[Any] | None:
        best: tuple[bool, float, list[Any]] | None = None
        held = sum(judge(values) for judge in self._terms)
        for place, value in self._candidates(values):
            far = abs(value - values[place]) / self._units[place]
            changed = [*values[:place], value, *values[place + 1 :]]
            left = sum(judge(changed) for judge in self._terms)
            if left < held and (best is None or (left > 0, far) < best[:2]):
                best = left > 0, far, changed
        return best[2] if best else None

    def _candidates(self, values: list[Any]) -> Iterator[tuple[int, Any]]:
        for root in self._roots:
            if not isinstance(values[root.place], int | float):
                continue
            try:
                found = root.where(values)
                sizes = [abs(float(each)) for each in (*values, root.threshold) if isinstance(each, int | float)]
            except (OverflowError, TypeError):
                continue
            if math.isfinite(found):
                largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
                for value in _near(found, self._types[root.place], largest):
                    yield root.place, value


def _near(root: float, kind: str, largest: float) -> Iterator[Any]:
    """Yield values of a type at a root and beside it."""
    limits = integer_range(kind)
    if limits is not None:
        low, high = limits
        yield from (value for step in _STEPS if low <= (value := math.floor(root) + step) <= high)
        return
    bits, lowest = _FLOATS[kind]
    # Rounding of a sum may be off by the last place of its largest part, of a quotient by its own.
    for unit in (_last_place(root, bits, lowest), _last_place(largest, bits, lowest)):
        for step in _STEPS:
            value = root + step * unit
            if bits == 24:
                value = _single(value)
            if math.isfinite(value):
                yield value


def _is_number(kind: str) -> bool:
    return kind in _FLOATS or integer_range(kind) is not None


def _last_place(value: float, bits: int, lowest: int) -> float:
    return math.ldexp(1.0, max(math.frexp(value)[1] - bits, lowest))


def _single(value: float) -> float:
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.inf
