"""Arrays as variables: set as a whole, and seen by rules as quantities of their elements and as single elements."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from functools import lru_cache

from riot_bus.vocabulary.elements import QUANTITIES, Elements, Quantity, quantity_of
from riot_bus.vocabulary.message import Scalar

Column = tuple[str, str, Callable[[Elements], Scalar]]
"""Name, type, and the function that reads it."""


@lru_cache(maxsize=256)
def columns_of_array(name: str, type_: str, places: tuple[int, ...]) -> tuple[Column, ...]:
    """Return an array's columns for rules: largest and smallest element, whether any is not finite, single elements.

    The name has one `[*]`, such as `/scan:ranges[*]`; the elements at `places` get a column each.
    """
    topic, colon, path = name.rpartition(":")

    def quantity(kind: str, of: str) -> Column:
        return f"{topic}{colon}{kind}({path})", of, QUANTITIES[kind]

    found = [quantity("max", type_), quantity("min", type_)]
    if type_.startswith("float"):
        found += [quantity("isnan", "bool"), quantity("nonfinite", "bool")]
    return (*found, *((f"{topic}{colon}{path.replace('[*]', f'[{place}]')}", type_, _at(place)) for place in places))


def _at(place: int) -> Callable[[Elements], Scalar]:
    return lambda elements: elements[place]


def with_column(elements: Elements, name: str, place: int | None, value: int | float) -> Elements:
    """Return the elements, changed as little as possible so that a column, the one of `place` if given, has a value."""
    found = quantity_of(name)
    if found is None or place is not None:
        assert place is not None
        return Elements((*elements[:place], value, *elements[place + 1 :]))
    return _with_quantity(elements, found, value)


def _with_quantity(elements: Elements, quantity: Quantity, value: int | float) -> Elements:
    up = quantity.kind == "max"
    extreme = elements.largest if up else elements.smallest
    at = elements.index(extreme) if extreme == extreme else 0
    kept = [min(each, value) if up else max(each, value) for each in elements]  # NaN stays where it is: it is first
    kept[at] = value
    return Elements(kept)


def known_elements(base: Elements, other: Elements, values: Sequence[int | float]) -> list[Elements]:
    """Return arrays with each known value of an element: in one place of either array, and in all places."""
    found: list[Elements] = []
    for number, value in enumerate(values):
        for array in (base, other):
            place = (7 * number + len(found)) % len(array)
            found.append(Elements((*array[:place], value, *array[place + 1 :])))
        found.append(Elements([value] * len(base)))
    return found


def drawn_elements(base: Elements, value: Callable[[], int | float], chance: random.Random) -> Elements:
    """Draw an array: the base with one, some, all but one or all elements drawn anew, equal or independent."""
    size, kind = len(base), chance.random()
    if kind < 0.1:
        return base
    if kind < 0.55:
        count = 1
    elif kind < 0.7:
        count = chance.randint(1, size)
    else:
        count = size - (kind > 0.9)
    places = chance.sample(range(size), count)
    alike = value() if chance.random() < 0.5 else None
    changed = list(base)
    for place in places:
        changed[place] = value() if alike is None else alike
    return Elements(changed)
