"""Rules: readable predicates over fields that predict the failure, and a distance to it (RIOT II-B c, II-D)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from riot_bus.generalize import rule_json
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.literals import FAR, Literal, arc_distances


@dataclass(frozen=True, slots=True)
class Rule:
    """A disjunction of conjunctions of literals: `a and b or c`. Without terms it never holds."""

    terms: tuple[tuple[Literal, ...], ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables it reads, sorted."""
        return tuple(sorted({name for term in self.terms for literal in term for name in literal.feature.args}))

    def renamed(self, words: Callable[[str], str]) -> Rule:
        """Return the rule with other names of its variables."""

        def other(literal: Literal) -> Literal:
            feature = literal.feature
            return replace(literal, feature=replace(feature, args=tuple(map(words, feature.args))))

        return Rule(tuple(tuple(map(other, term)) for term in self.terms))

    def predict(self, columns: Mapping[str, Array]) -> Array:
        """Return for each row whether the failure is predicted; columns of strings and bytes are object arrays.

        Raises:
            ConfigError: If a variable has no column.
        """
        result = np.zeros(_shape(columns), dtype=bool)
        for term in self.terms:
            result |= _hold(term, columns, _shape(columns))
        return result

    def judge(self, columns: Mapping[str, Array], rows: int) -> tuple[Array, Array]:
        """Return for each row whether the failure is predicted whatever the variables without a column are, and if any.

        The second is whether values of these variables are possible with which the failure is predicted; each literal
        that reads one counts as open, even where two of them exclude each other.
        """
        sure, possible = np.zeros(rows, dtype=bool), np.zeros(rows, dtype=bool)
        for term in self.terms:
            known = [literal for literal in term if all(name in columns for name in literal.feature.args)]
            inside = _hold(known, columns, (rows,))
            possible |= inside
            if len(known) == len(term):
                sure |= inside
        return sure, possible

    def distance(self, columns: Mapping[str, Array], scale: Mapping[str, float]) -> Array:
        """Return how far each row is from the predicted failure: negative inside, never NaN, at most 1e18 in size.

        It is the largest over the literals of a term and the smallest over the terms: an objective for an optimiser.

        Raises:
            ConfigError: If a variable has no column.
        """
        result = np.full(_shape(columns), FAR)
        for term in self.terms:
            worst = np.full(_shape(columns), -FAR)
            for literal in term:
                worst = np.maximum(worst, literal.distance(columns, scale))
            for far in arc_distances(term, columns, scale):
                worst = np.maximum(worst, far)
            result = np.minimum(result, worst)
        return result

    def text(self) -> str:
        """Return the rule in one line, such as `x * y < 0 or x * y > 4194304`; shared literals appear once."""
        if len(self.terms) < 2:
            return _all_of(self.terms[0]) if self.terms else "never"
        shared = tuple(each for each in self.terms[0] if all(each in term for term in self.terms))
        rests = [tuple(each for each in term if each not in shared) for term in self.terms]
        if not all(rests):
            return _all_of(shared)  # the others only hold where it does
        either = " or ".join(f"({_all_of(rest)})" if len(rest) > 1 else _all_of(rest) for rest in rests)
        return f"{_all_of(shared)} and ({either})" if shared else either

    def to_dict(self) -> dict[str, Any]:
        """Return the versioned JSON object, to be embedded in other files."""
        return rule_json.encode(self.terms)

    def to_json(self) -> str:
        """Return the rule as versioned JSON text."""
        return json.dumps(self.to_dict(), allow_nan=False)

    @classmethod
    def from_json(cls, source: str | bytes | Mapping[str, Any]) -> Rule:
        """Read a rule from JSON text or from the object within another file.

        Raises:
            ConfigError: If it is not a rule of a known version.
        """
        return cls(rule_json.decode(source))


def _hold(literals: Iterable[Literal], columns: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
    inside = np.ones(shape, dtype=bool)
    for literal in literals:
        inside &= literal.holds(columns)
    return inside


def _all_of(literals: Iterable[Literal]) -> str:
    return " and ".join(literal.text() for literal in literals) or "always"


def _shape(columns: Mapping[str, Array]) -> tuple[int, ...]:
    for column in columns.values():
        return np.asarray(column).shape
    return (0,)
