"""The nearest values for which a rule does not hold, derived from its thresholds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from riot_bus.generalize.forms.function import compiled, term_judges
from riot_bus.generalize.forms.standalone import FLOATS, INTEGERS, Root, Term, nearest
from riot_bus.generalize.forms.tree import NO_ROOTS, Terms, Tree, roots


def why_not_repairable(terms: Terms, names: Sequence[str], types: Mapping[str, str]) -> str:
    """Return why a rule has no nearest values for which it does not hold; empty if it has."""
    movable = [name for name in names if _is_number(types.get(name, ""))]
    for term in terms:
        if not any(roots(literal, name) for literal in term for name in movable):
            text = " and ".join(literal.text() for literal in term) or "always"
            kinds = [NO_ROOTS[literal.feature.kind] for literal in term if literal.feature.kind in NO_ROOTS]
            return f"{text!r} has no nearest value for which it is false" + (f": {kinds[0]}" if kinds else "")
    return ""


def where_it_changes(
    terms: Terms, movable: Sequence[str], types: Mapping[str, str]
) -> list[tuple[str, Tree, int | float]]:
    """Return variable, root and threshold of each literal that moving a number can make false."""
    literals = dict.fromkeys(literal for term in terms for literal in term)
    return [
        (name, root, literal.value)
        for literal in literals
        for name in movable
        if _is_number(types.get(name, "")) and isinstance(literal.value, int | float)
        for root in roots(literal, name)
    ]


def unit_of(scale: Mapping[str, float], name: str) -> float:
    """Return the unit of a variable's moves: its nominal spread, 1 where there is none."""
    return scale[name] if 0 < scale.get(name, 0) < math.inf else 1.0


class Repair:
    """Function that changes values so that a rule does not hold; see `standalone.nearest`."""

    def __init__(
        self,
        terms: Terms,
        names: Sequence[str],
        *,
        movable: Sequence[str],
        types: Mapping[str, str],
        scale: Mapping[str, float],
    ) -> None:
        self._terms: list[Term] = [_spread(judge) for judge in term_judges(terms, names)]
        self._kinds = [types.get(name, "") for name in names]
        self._units = [unit_of(scale, name) for name in names]
        self._roots: list[Root] = [
            (names.index(name), _spread(compiled(root, names)), value)
            for name, root, value in where_it_changes(terms, movable, types)
        ]

    def __call__(self, values: Sequence[Any]) -> list[Any] | None:
        """Return values for which the rule does not hold; None if none are found."""
        try:
            return nearest(values, self._terms, self._roots, self._kinds, self._units)
        except (OverflowError, TypeError):  # a value has the wrong type, or is too large
            return None


def _spread(function: Callable[[Sequence[Any]], Any]) -> Callable[..., Any]:
    return lambda *values: function(values)


def _is_number(kind: str) -> bool:
    return kind in FLOATS or kind in INTEGERS
