"""Where the values of trials come from: nominal range, dictionary, log-uniform over the type, and known samples."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.generalize.features import Array
from riot_bus.generalize.oracle import scalar_key
from riot_bus.generalize.texts import varied
from riot_bus.vocabulary.trial import Scalar

__all__ = ["TYPES", "Sampler", "Variable", "columns_of", "fit", "fitted", "integer_range", "interesting"]

Assignment = Mapping[str, Scalar]

TYPES = (
    "bool",
    *(f"{sign}int{size}" for sign in ("", "u") for size in (8, 16, 32, 64)),
    "float32",
    "float64",
    "string",
    "bytes",
)
"""The types a variable may have."""

_FLOAT32_MAX = 3.4028234663852886e38
_DTYPES = {"float32": np.float64, "float64": np.float64, "bool": np.bool_, "string": np.object_, "bytes": np.object_}


@dataclass(frozen=True, slots=True)
class Variable:
    """One relevant field as a variable of the rule.

    `type` is one of bool, int8 .. int64, uint8 .. uint64, float32, float64, string, bytes. `failing` is its value in
    the failing log, `passing` values that heal (from certificates), `nominal` observed ones, `dictionary` exceptional
    ones.
    """

    name: str
    type: str
    failing: Scalar
    passing: tuple[Scalar, ...] = ()
    nominal: tuple[Scalar, ...] = ()
    dictionary: tuple[Scalar, ...] = ()


def fitted(variable: Variable) -> Variable:
    """Return the variable with all its values as its type holds them; without those that it cannot hold.

    Raises:
        ValueError: If the type is unknown or cannot hold the failing value.
    """
    if variable.type not in TYPES:
        raise ValueError(
            f"variable {variable.name!r} has the unknown type {variable.type!r}; known: {', '.join(TYPES)}"
        )
    failing = fit(variable.failing, variable.type)
    if failing is None:
        raise ValueError(f"variable {variable.name!r}: {variable.type} cannot hold the value {variable.failing!r}")

    def fit_all(values: Sequence[Scalar]) -> tuple[Scalar, ...]:
        return tuple(value for value in (fit(value, variable.type) for value in values) if value is not None)

    return replace(
        variable,
        failing=failing,
        passing=fit_all(variable.passing),
        nominal=fit_all(variable.nominal),
        dictionary=fit_all(variable.dictionary),
    )


def integer_range(type_: str) -> tuple[int, int] | None:
    """Return the smallest and largest value of an integer type, None for other types."""
    if type_.startswith("uint"):
        return 0, 2 ** int(type_[4:]) - 1
    if type_.startswith("int"):
        return -(2 ** (int(type_[3:]) - 1)), 2 ** (int(type_[3:]) - 1) - 1
    return None


def fit(value: Scalar, type_: str) -> Scalar | None:
    """Return the value as this type can hold it, or None when it cannot."""
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
    elif variable.type == "bool":
        edges = [False, True]
    elif variable.type == "string":
        edges = [""]
    else:
        edges = [b""]
    known = [variable.failing, *variable.passing, *edges, *variable.dictionary, *_spread(variable.nominal)]
    held = [value for value in (fit(value, variable.type) for value in known) if value is not None]
    return list({scalar_key(value): value for value in held}.values())


def _spread(values: Sequence[Scalar]) -> list[Scalar]:
    """Return up to seven of the values, the smallest and largest among them."""
    ordered = sorted({scalar_key(value): value for value in values}.values())
    count = min(7, len(ordered))
    return [ordered[index * (len(ordered) - 1) // max(count - 1, 1)] for index in range(count)]


class Sampler:
    """Draws assignments: nominal, interesting, log-uniform over the type, or near an interesting value.

    Args:
        variables: The variables; each draw gives all of them a value.
    """

    def __init__(self, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        self.known = {variable.name: interesting(variable) for variable in variables}

    def assignment(self, chance: random.Random) -> dict[str, Scalar]:
        """Draw a value for every variable."""
        return {variable.name: self.value(variable, chance) for variable in self.variables}

    def value(self, variable: Variable, chance: random.Random) -> Scalar:
        """Draw one value of one variable."""
        kind = chance.random()
        known = self.known[variable.name]
        if variable.type in ("string", "bytes") and kind > 0.6:
            return varied(known, chance)  # type: ignore[type-var]
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


def _nominal(variable: Variable, chance: random.Random) -> Scalar:
    """Draw from the nominal range: an observed value, or any between two observed ones."""
    left, right = chance.choice(variable.nominal), chance.choice(variable.nominal)
    if isinstance(left, str | bytes) or isinstance(right, str | bytes) or chance.random() < 0.5:
        return left
    if not (math.isfinite(left) and math.isfinite(right)):
        return left
    value = fit(left + (right - left) * chance.random(), variable.type)
    return left if value is None else value


def _beside(base: int, chance: random.Random) -> int:
    """Return a number a little beside, a few times something round away, or with another bit."""
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
    """Return assignments as one array per variable."""
    columns: dict[str, Array] = {}
    for variable in variables:
        dtype = _DTYPES.get(variable.type)
        if dtype is None:
            dtype = np.uint64 if variable.type == "uint64" else np.int64
        column: Array = np.empty(len(assignments), dtype=dtype)
        for row, assignment in enumerate(assignments):
            column[row] = assignment[variable.name]
        columns[variable.name] = column
    return columns
