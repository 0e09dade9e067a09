"""Expressions over the variables of a rule: a small tree that is evaluated exactly, written as text, or walked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from riot_bus.vocabulary.elements import quantity_of

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True, slots=True)
class Applied:
    """An operator, one of `OPERATORS`, applied to variables, constants and further calls."""

    operator: str
    args: tuple[Node, ...]


Node = Applied | Name | int | float | str | bytes

TEXTS: Final[Mapping[str, Callable[..., int | None]]] = {
    "len": len,
    "bytes": lambda value: len(value.encode("utf-8", "surrogatepass") if isinstance(value, str) else value),
    "isascii": lambda value: value.isascii(),
    "isprintable": lambda value: value.isprintable() if isinstance(value, str) else None,
    "isdigit": lambda value: value.isdigit(),
    "isutf8": lambda value: value.decode(errors="replace").encode() == value if isinstance(value, bytes) else None,
    "startswith": lambda value, begin: value.startswith(begin),
    "contains": lambda value, part: part in value,
}
"""Operators whose first argument is a text or bytes; None for the kind of text that has no such property."""

OPERATORS: Final = frozenset(
    {"add", "sub", "mul", "div", "mod", "and", "abs", "hypot", "max", "min", "signed", "isnan", "isfinite", "not"}
    | TEXTS.keys()
)
"""Operators of an `Applied`. Numbers are exact: integers of any size, floats of 64 bits.

`mod` of a negative number is not negative; `signed` is the value as held by a signed integer of the given number of
bits; `bytes` is the length of a text in UTF-8; flags are 0 and 1.
"""

_INFIX: Final = {"add": ("+", 1), "sub": ("-", 1), "mul": ("*", 2), "div": ("/", 2), "mod": ("%", 2)}
_ATOM: Final = 3  # precedence of what needs no parentheses: above those in `_INFIX`


def numeric(column: Array) -> Array | None:
    """Return a column as int64, exact Python integers (object) or float64; None when it does not hold numbers.

    Booleans count as 0 and 1.
    """
    kind = column.dtype.kind
    if kind in "bi":
        return column.astype(np.int64)
    if kind == "u":
        wide = column.dtype.itemsize == 8 and column.size and int(column.max()) >= 2**63
        return column.astype(object) if wide else column.astype(np.int64)
    if kind == "f":
        return column.astype(np.float64)
    if kind != "O":
        return None
    values = column.tolist()
    if not all(isinstance(value, bool | int | float) for value in values):
        return None
    if any(isinstance(value, float) for value in values):
        return np.array([float(value) for value in values], dtype=np.float64)
    if all(-(2**63) <= value < 2**63 for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([int(value) for value in values], dtype=object)


def evaluate(node: Node, column: Callable[[str], Array]) -> Array | None:
    """Return the value of each row, exact for integers; None when a column does not hold what an operator takes.

    Returns:
        int64, object (exact Python integers beyond int64) or float64; flags are booleans, or 1.0, 0.0 and NaN (in rows
        without a text).
    """
    if isinstance(node, Name):
        return numeric(np.asarray(column(node.name)))
    if isinstance(node, int | float):
        return np.array(node, dtype=object if isinstance(node, int) and not -(2**63) <= node < 2**63 else None)
    assert isinstance(node, Applied)  # only operators on texts have constant texts as arguments
    if node.operator in TEXTS:
        subject, *constants = node.args
        assert isinstance(subject, Name)
        return _of_texts(node.operator, np.asarray(column(subject.name)), constants)
    found = [evaluate(arg, column) for arg in node.args]
    arrays = [array for array in found if array is not None]
    return _apply(node.operator, arrays) if len(arrays) == len(found) else None


def _apply(operator: str, arrays: list[Array]) -> Array:
    first = arrays[0]
    if len(arrays) == 1:
        return _unary(operator, first)
    second = arrays[1]
    if operator in _EXACT:
        return _exact(first, second, *_EXACT[operator])
    if operator == "signed":
        half = 2 ** (int(second) - 1)
        return _exact(first, np.array(half, dtype=object), lambda a, h: (a + h) % (2 * h) - h, lambda a, h: a + 2 * h)
    if operator in ("div", "hypot"):
        with np.errstate(all="ignore"):
            left, right = first.astype(np.float64), second.astype(np.float64)
            return np.asarray(left / right if operator == "div" else np.hypot(left, right))
    if "f" in (first.dtype.kind, second.dtype.kind):
        first, second = first.astype(np.float64), second.astype(np.float64)
    return np.asarray((np.maximum if operator == "max" else np.minimum)(first, second))


def _unary(operator: str, array: Array) -> Array:
    if operator == "abs":
        if array.dtype.kind == "i" and array.size and int(array.min()) == -(2**63):
            array = array.astype(object)
        return np.asarray(np.abs(array))
    if operator == "not":
        return np.asarray(1.0 - array if array.dtype.kind == "f" else ~array)
    if array.dtype.kind != "f":
        return np.full(array.shape, operator == "isfinite")
    return np.asarray(np.isnan(array) if operator == "isnan" else np.isfinite(array))


_EXACT: Final[dict[str, tuple[Callable[[Any, Any], Any], Callable[[int, int], int]]]] = {
    # operator: what it does, and the largest size of its result
    "add": (lambda a, b: a + b, lambda a, b: a + b),
    "sub": (lambda a, b: a - b, lambda a, b: a + b),
    "mul": (lambda a, b: a * b, lambda a, b: a * b),
    "mod": (lambda a, b: a % b, max),
    "and": (lambda a, b: a & b, max),
}


def _largest(array: Array) -> int:
    return max(abs(int(array.max())), abs(int(array.min()))) if array.size else 0


def _exact(left: Array, right: Array, operate: Callable[[Any, Any], Any], bound: Callable[[int, int], int]) -> Array:
    """Apply an operator without overflow: int64 where the result fits, Python integers where not, else float64."""
    if left.dtype.kind == "f" or right.dtype.kind == "f":
        with np.errstate(all="ignore"):
            left, right = left.astype(np.float64), right.astype(np.float64)
            try:
                return np.asarray(operate(left, right))
            except TypeError:  # bits of a float
                return np.full(np.broadcast(left, right).shape, np.nan)
    if bound(_largest(left), _largest(right)) < 2**63:
        return np.asarray(operate(left.astype(np.int64), right.astype(np.int64)))
    return np.asarray(operate(left.astype(object), right.astype(object)), dtype=object)


def _of_texts(operator: str, column: Array, constants: list[Node]) -> Array | None:
    if column.dtype.kind not in "UOS":
        return None
    values = [of_text(operator, value, constants) for value in column.ravel().tolist()]
    if operator in ("len", "bytes") and None not in values:
        return np.array(values, dtype=np.int64).reshape(column.shape)
    numbers = [np.nan if value is None else float(value) for value in values]
    return np.array(numbers, dtype=np.float64).reshape(column.shape)


def of_text(operator: str, value: object, constants: Sequence[Node]) -> int | None:
    """Return the result of a text operator for a value; None if it is not a text, or of the other kind of text."""
    if not isinstance(value, str | bytes) or (constants and not isinstance(constants[0], type(value))):
        return None
    return TEXTS[operator](value, *constants)


def text(node: Node) -> str:
    """Return an expression as people write it."""
    return _write(node)[0]


def _write(node: Node) -> tuple[str, int]:
    """Return the text of a node and its precedence."""
    if isinstance(node, Name):
        quantity = quantity_of(node.name)
        return (f"{quantity.kind}({quantity.topic}{quantity.path})" if quantity else node.name), _ATOM
    if not isinstance(node, Applied):
        power = isinstance(node, int) and node >= 2**16 and node & (node - 1) == 0
        return (f"2**{node.bit_length() - 1}" if power else repr(node)), _ATOM  # type: ignore[union-attr]
    parts = [_write(arg) for arg in node.args]
    if node.operator == "and":
        return f"({parts[0][0]} & {parts[1][0]})", _ATOM
    if node.operator == "not":
        return f"not {parts[0][0]}", 0
    if node.operator in _INFIX:
        sign, level = _INFIX[node.operator]
        left = parts[0][0] if parts[0][1] >= level else f"({parts[0][0]})"
        right = parts[1][0] if parts[1][1] > level or (sign in "+*" and parts[1][1] == level) else f"({parts[1][0]})"
        if node.operator == "mod" and parts[0][1] < _ATOM:
            left = f"({parts[0][0]})"
        return f"{left} {sign} {right}", level
    args = [part for part, _ in parts]
    return (f"int{args[1]}({args[0]})" if node.operator == "signed" else f"{node.operator}({', '.join(args)})"), _ATOM
