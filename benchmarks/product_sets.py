"""Rules as unions of products of one set per field (HPSL: Vernaza et al., IROS 2015), as a peer in generalize.py.

Around a failing case, each field alone takes other values: the set of a number is an interval whose ends are bisected,
that of anything else the values that failed. Cases that fail outside of all products begin another one.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from riot_bus.generalize.numbers import between
from riot_bus.generalize.oracle import same_scalar

__all__ = ["product_sets"]

Case = Mapping[str, Any]
Fails = Callable[[Case], bool]

_LARGE = 2**62
"""A number beyond this still fails: the set has no end on this side."""
_DRAWS = 20
"""Cases drawn for each question: those that are predicted to fail are not asked."""
_OTHERS = 4
"""Values that are no numbers tried of each field."""


@dataclass
class _Set:
    """An interval, and single values."""

    low: float = math.inf
    high: float = -math.inf
    others: list[Any] = field(default_factory=list)

    def __contains__(self, value: object) -> bool:
        if isinstance(value, int | float) and _is_number(value) and self.low <= value <= self.high:
            return True
        return any(same_scalar(value, one) for one in self.others)  # type: ignore[arg-type]


def product_sets(failing: Case, known: Mapping[str, Sequence[Any]], fails: Fails, budget: int, seed: int) -> Fails:
    """Return a function that predicts failures, learnt by so many questions.

    Args:
        failing: A case that fails.
        known: Values of each field to try.
        fails: The function to learn.
        budget: Number of questions.
        seed: Seed of the cases that look for further products.
    """
    chance = random.Random(seed)
    products: list[dict[str, _Set]] = []
    left = iter(range(budget))

    def ask(case: Case) -> bool:
        next(left)
        return fails(case)

    def said(case: Case) -> bool:
        return any(all(case[name] in one for name, one in sets.items()) for sets in products)

    with contextlib.suppress(StopIteration):
        case = failing
        for _ in range(_DRAWS * budget):
            if not said(case) and ask(case):
                products.append({name: _Set(others=[value]) for name, value in case.items()})
                for name, found in products[-1].items():
                    _extend(found, case, name, known[name], ask, chance)
            case = {name: chance.choice(values) for name, values in known.items()}
    return said


def _extend(found: _Set, case: Case, name: str, known: Sequence[Any], ask: Fails, chance: random.Random) -> None:
    start = case[name]
    numbers = [value for value in known if _is_number(value)] if _is_number(start) else []
    rest = [value for value in known if not any(value is one for one in numbers)]
    for value in chance.sample(rest, min(_OTHERS, len(rest))):
        if ask({**case, name: value}):
            found.others.append(value)
    if not numbers:
        return
    found.low = found.high = start
    for end, beyond in (("low", min(numbers)), ("high", max(numbers))):
        inside, outside = start, beyond
        if inside == outside or ask({**case, name: beyond}):
            open_ = isinstance(start, float) or abs(beyond) > _LARGE
            setattr(found, end, math.copysign(math.inf, beyond - start) if open_ and inside != outside else beyond)
            continue
        while (middle := between(*sorted((inside, outside)))) is not None:
            if ask({**case, name: middle}):
                inside = middle
            else:
                outside = middle
            setattr(found, end, inside)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
