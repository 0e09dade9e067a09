"""Sources of the values of trials: nominal range, dictionary, log-uniform over the type, and known samples."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from riot_bus.generalize.arrays import Column, columns_of_array, drawn_elements, known_elements, with_column
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.forms.standalone import FLOATS, INTEGERS
from riot_bus.generalize.oracle import scalar_key
from riot_bus.generalize.texts import varied
from riot_bus.vocabulary.elements import Elements, Setting
from riot_bus.vocabulary.message import Scalar

Assignment = Mapping[str, Setting]

TYPES = ("bool", *INTEGERS, *FLOATS, "string", "bytes")
"""The types a variable may have."""

_FLOAT32_MAX = 3.4028234663852886e38  # largest finite float32, (2 - 2**-23) * 2**127: struct.pack refuses more
_DTYPES = {"float32": np.float64, "float64": np.float64, "bool": np.bool_, "string": np.object_, "bytes": np.object_}


@dataclass(frozen=True, slots=True)
class Variable:
    """One relevant field as a variable of the rule, or the elements of an array.

    `type` is one of bool, int8 .. int64, uint8 .. uint64, float32, float64, string, bytes. `failing` is its value in
    the failing log, `passing` values that heal (from certificates), `nominal` observed ones, `dictionary` exceptional
    ones. An array has a name with `[*]`, the type of its elements followed by `[]`, values that are `Elements` of one
    length (except in its dictionary), and `places`: indices of the elements that rules may treat one by one.
    """

    name: str
    type: str
    failing: Setting
    passing: tuple[Setting, ...] = ()
    nominal: tuple[Setting, ...] = ()
    dictionary: tuple[Scalar, ...] = ()
    places: tuple[int, ...] = ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """What rules see of an array; empty for other variables, which rules see directly."""
        return columns_of_array(self.name, self.type[:-2], self.places) if self.type.endswith("[]") else ()


def fitted(variable: Variable) -> Variable:
    """Return the variable with all values converted to its type, without those that the type cannot hold.

    Raises:
        ValueError: If the type is unknown or cannot hold the failing value.
    """
    type_ = variable.type.removesuffix("[]")
    if type_ not in TYPES or (variable.columns and type_ in ("bool", "string", "bytes")):
        raise ValueError(
            f"variable {variable.name!r} has the unknown type {variable.type!r}; known: {', '.join(TYPES)}"
        )
    failing = fit(variable.failing, variable.type)
    if failing is None:
        raise ValueError(f"variable {variable.name!r}: {variable.type} cannot hold the value {variable.failing!r}")

    def fit_all(values: Sequence[Setting]) -> tuple[Setting, ...]:
        return tuple(value for value in (fit(value, variable.type) for value in values) if value is not None)

    entries = (fit(value, type_) for value in variable.dictionary)
    return replace(
        variable,
        failing=failing,
        passing=fit_all(variable.passing),
        nominal=fit_all(variable.nominal),
        dictionary=tuple(value for value in entries if value is not None),
    )


def scalars_of(variables: Sequence[Variable]) -> list[Variable]:
    """Return the variables as rules see them: the columns of an array in its place."""
    found: list[Variable] = []
    for variable in variables:
        if not variable.columns:
            found.append(variable)
        for name, type_, read in variable.columns:
            passing, nominal = (
                tuple(read(value) for value in values if isinstance(value, Elements))
                for values in (variable.passing, variable.nominal)
            )
            assert isinstance(variable.failing, Elements)
            found.append(Variable(name, type_, read(variable.failing), passing, nominal))
    return found


def row_of(variables: Sequence[Variable], assignment: Assignment) -> dict[str, Scalar]:
    """Return the values of an assignment as rules see them."""
    row: dict[str, Scalar] = {}
    for variable in variables:
        value = assignment[variable.name]
        if isinstance(value, Elements):
            row.update((name, read(value)) for name, _, read in variable.columns)
        else:
            row[variable.name] = value
    return row


def changed(
    variables: Sequence[Variable], base: Assignment, change: Mapping[str, Setting]
) -> dict[str, Setting] | None:
    """Return the base with values by name of a variable or column; None for no change or one that does not fit."""
    found = dict(base)
    for variable in variables:
        if variable.name in change:
            value = fit(change[variable.name], variable.type)
            if value is None:
                return None
            found[variable.name] = value
        elements = found[variable.name]
        for number, (name, type_, _) in enumerate(variable.columns):
            if name not in change:
                continue
            scalar = fit(change[name], type_)
            if not isinstance(scalar, int | float) or isinstance(scalar, bool) or not isinstance(elements, Elements):
                return None
            single = number - len(variable.columns) + len(variable.places)
            elements = with_column(elements, name, variable.places[single] if single >= 0 else None, scalar)
            found[variable.name] = elements
    return found if change else None


def integer_range(type_: str) -> tuple[int, int] | None:
    """Return the smallest and largest value of an integer type, None for other types."""
    return INTEGERS.get(type_)


def fit(value: Setting, type_: str) -> Any:
    """Return the value as this type can hold it, or None when it cannot."""
    if isinstance(value, Elements) or type_.endswith("[]"):
        arrays = isinstance(value, Elements) and type_.endswith("[]")
        held: list[Any] = [fit(each, type_[:-2]) for each in value] if arrays else [None]  # type: ignore[union-attr]
        return None if None in held else Elements(held)
    limits = integer_range(type_)
    if limits is not None:
        if isinstance(value, str | bytes) or (isinstance(value, float) and not math.isfinite(value)):
            return None
        whole = int(value)
        return whole if limits[0] <= whole <= limits[1] else None
    if type_.startswith("float"):
        if isinstance(value, str | bytes):
            return None
        try:
            number = float(value)
        except OverflowError:
            return None
        if type_ == "float32" and math.isfinite(number):
            if abs(number) > _FLOAT32_MAX:
                return None
            narrowed: float = struct.unpack("<f", struct.pack("<f", number))[0]
            return narrowed
        return number
    kinds = {"bool": bool, "string": str, "bytes": bytes}
    return value if isinstance(value, kinds[type_]) else None


def interesting(variable: Variable) -> list[Scalar]:
    """Return the distinct known values of a variable: failing, passing, dictionary, edges of the type, some nominal."""
    limits = integer_range(variable.type)
    edges: list[Scalar]
    if limits is not None:
        edges = [0, 1, *limits, limits[1] // 2, *([-1] if limits[0] else [])]
        if limits[1] < 256:  # most likely an enumeration
            edges += range(2, 10)
    elif variable.type.startswith("float"):
        edges = [0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e6, -1e6]
    else:
        single: dict[str, list[Scalar]] = {"bool": [False, True], "string": [""], "bytes": [b""]}
        edges = single[variable.type]
    known: list[Any] = [variable.failing, *variable.passing, *edges, *variable.dictionary, *_spread(variable.nominal)]
    held = [value for value in (fit(value, variable.type) for value in known) if value is not None]
    return list({scalar_key(value): value for value in held}.values())


def _spread(values: Sequence[Any]) -> list[Scalar]:
    """Return up to seven of the values, the smallest and largest among them."""
    ordered = sorted({scalar_key(value): value for value in values}.values())
    count = min(7, len(ordered))
    return [ordered[index * (len(ordered) - 1) // max(count - 1, 1)] for index in range(count)]


class Sampler:
    """Draws assignments: nominal, interesting, log-uniform over the type, or near an interesting value."""

    def __init__(self, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        self._elements = {variable.name: _element(variable) for variable in variables if variable.columns}
        self.known: dict[str, list[Any]] = {
            variable.name: self._arrays(variable) if variable.columns else interesting(variable)
            for variable in variables
        }
        self.known.update((element.name, interesting(element)) for element in self._elements.values())

    def _arrays(self, variable: Variable) -> list[Setting]:
        """Return known arrays: failing, passing, nominal ones, and these with each known value of an element."""
        own = [variable.failing, *variable.passing, *variable.nominal[:7]]
        base, other = variable.failing, (*variable.nominal, *variable.passing, variable.failing)[0]
        assert isinstance(base, Elements)
        assert isinstance(other, Elements)
        numbers: list[Any] = interesting(self._elements[variable.name])
        found = [*own, *known_elements(base, other, numbers)]
        return list({scalar_key(value): value for value in found}.values())

    def behind(self, name: str) -> Variable:
        """Return the variable of this name, or the array with a column of this name."""
        for variable in self.variables:
            if name == variable.name or any(name == column for column, _, _ in variable.columns):
                return variable
        raise KeyError(name)

    def assignment(self, chance: random.Random) -> dict[str, Setting]:
        """Draw a value for every variable."""
        return {variable.name: self.value(variable, chance) for variable in self.variables}

    def value(self, variable: Variable, chance: random.Random) -> Any:
        """Draw one value of one variable."""
        if variable.columns:
            element = self._elements[variable.name]
            base = chance.choice([variable.failing, *(chance.choice(variable.nominal) for _ in variable.nominal[:2])])
            assert isinstance(base, Elements)
            return drawn_elements(base, lambda: self.value(element, chance), chance)
        kind = chance.random()
        known = self.known[variable.name]
        if variable.type in ("string", "bytes") and kind > 0.6:
            return varied(known, chance)
        if variable.type in ("bool", "string", "bytes"):
            return chance.choice(list(variable.nominal) if variable.nominal and kind < 0.3 else known)
        if kind < 0.3 and variable.nominal:
            return _nominal(variable, chance)
        if kind < 0.55:
            return chance.choice(known)
        if kind < 0.65:
            base = chance.choice(known)
            near = fit(_beside(base, chance), variable.type) if isinstance(base, int) else None
            return base if near is None else near
        return _log_uniform(variable.type, chance)


def _element(variable: Variable) -> Variable:
    """Return one element of an array as a variable of its own."""
    arrays = [value for value in (variable.failing, *variable.passing) if isinstance(value, Elements)]
    at = [value for array in arrays for value in (array[place] for place in variable.places)]
    nominal = [value for array in variable.nominal if isinstance(array, Elements) for value in array]
    some = tuple(nominal[:: max(1, len(nominal) // 200)])  # thinned out evenly
    failing = at[0] if at else arrays[0][0]
    name, type_ = variable.name.replace("[*]", "[?]"), variable.type[:-2]
    return Variable(name, type_, failing, tuple(at[1:]), some, variable.dictionary)


def _nominal(variable: Variable, chance: random.Random) -> Any:
    """Draw from the nominal range: an observed value, or any between two observed ones."""
    values: tuple[Any, ...] = variable.nominal
    left, right = chance.choice(values), chance.choice(values)
    if isinstance(left, str | bytes) or isinstance(right, str | bytes) or chance.random() < 0.5:
        return left
    if not (math.isfinite(left) and math.isfinite(right)):
        return left
    value = fit(left + (right - left) * chance.random(), variable.type)
    return left if value is None else value


def _beside(base: int, chance: random.Random) -> int:
    """Return a number close by, away by a multiple of a round number, or with one bit flipped."""
    kind = chance.randrange(4)
    if kind == 0:
        return base ^ (1 << chance.randrange(max(8, min(base.bit_length() + 1, 32))))
    if kind == 1:
        return base + chance.choice((-1, 1)) * chance.randint(1, 50) * chance.choice((4, 8, 10, 16, 100, 256, 1000))
    return base + chance.choice((-2, -1, 1, 2))


def _log_uniform(type_: str, chance: random.Random) -> Scalar:
    limits = integer_range(type_)
    sign = -1 if chance.random() < 0.5 else 1
    if limits is not None:
        sign = sign if limits[0] else 1
        size = int(2 ** (chance.random() * limits[1].bit_length()))
        return min(max(sign * (size - 1), limits[0]), limits[1])
    top = 38.0 if type_ == "float32" else 100.0
    # Half of the draws within the sizes that engineers use, the others over (nearly) the whole type.
    power = chance.uniform(-3.0, 9.0) if chance.random() < 0.6 else chance.uniform(-top, top)
    value = fit(sign * 10**power, type_)
    return 0.0 if value is None else value


def columns_of(variables: Sequence[Variable], assignments: Sequence[Assignment]) -> dict[str, Array]:
    """Return assignments as one array per variable, or per column of a variable that is an array."""
    columns: dict[str, Array] = {}
    for variable in variables:
        values = [assignment[variable.name] for assignment in assignments]
        if not variable.columns:
            columns[variable.name] = _column(values, variable.type)
        for name, type_, read in variable.columns:
            columns[name] = _column([read(value) for value in values if isinstance(value, Elements)], type_)
    return columns


def _column(values: Sequence[Setting], type_: str) -> Array:
    column: Array = np.empty(len(values), dtype=_DTYPES.get(type_, np.uint64 if type_ == "uint64" else np.int64))
    for row, value in enumerate(values):
        column[row] = value
    return column
