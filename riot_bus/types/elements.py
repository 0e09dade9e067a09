"""Reading of all elements of an array, and of quantities of them, such as their maximum, like fields."""

from __future__ import annotations

import re
from functools import lru_cache

from riot_bus.types.model import MessageType
from riot_bus.vocabulary.elements import MOST_ELEMENTS, QUANTITIES, Elements, quantity_of
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar


def read_field(kind: MessageType, payload: bytes, path: str) -> Scalar:
    """Return a field's value, or a quantity of elements such as `max(ranges[*])`.

    Raises:
        PayloadError: There is no such field or array, or the array has too many elements, or not only numbers.
    """
    quantity = quantity_of(path)
    if quantity is None:
        return kind.read(payload, path)
    return QUANTITIES[quantity.kind](read_elements(kind, payload, quantity.path))


def read_elements(kind: MessageType, payload: bytes, path: str) -> Elements:
    """Return the elements of an array, or one field of its records; `path` has one `[*]`, as in `poses[*].x`.

    Raises:
        PayloadError: There is no such array, or it has too many elements, or not only numbers.
    """
    pattern = _pattern(path)
    leaves = kind.leaves(payload, elements=MOST_ELEMENTS + 1)
    length = f"len({path.partition('[*]')[0]})"
    found = [leaf.value for leaf in leaves if pattern.fullmatch(leaf.path)]
    if not found and not any(leaf.path == length for leaf in leaves):
        raise PayloadError("no such array", where=path)
    if len(found) > MOST_ELEMENTS:
        raise PayloadError(f"an array of more than {MOST_ELEMENTS} elements is not judged", where=path)
    numbers = [value for value in found if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < len(found):
        raise PayloadError("not all elements are numbers", where=path)
    return Elements(numbers)


@lru_cache(maxsize=256)
def _pattern(path: str) -> re.Pattern[str]:
    array, _, rest = path.partition("[*]")
    return re.compile(re.escape(array) + r"\[\d+\]" + re.escape(rest), re.DOTALL)
