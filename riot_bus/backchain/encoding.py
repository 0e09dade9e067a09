"""External fields on a symmetric log scale around nominal, so that one step covers 1 m and 5,000 m (RIOT II-D)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from riot_bus.backchain.fir import Floats

_DIGITS = 3  # steps of a thousandth of the distance from nominal: finer ones make no difference
_FEW = 16  # a guess: modes have fewer values; counts and other quantities have more


@dataclass(frozen=True, slots=True)
class SearchField:
    """An external field that a search may set.

    Attributes:
        nominal: Usual value, in the field's unit.
        spread: Spread of the nominal log, in the field's unit; positive. The scale is linear within it.
        choice: Whether values are positions in a list, so that nothing lies between two of them.

    Raises:
        ValueError: The spread is not positive, or the range is empty or not finite.
    """

    name: str
    nominal: float
    spread: float
    low: float
    high: float
    integer: bool = False
    choice: bool = False

    def __post_init__(self) -> None:
        if not self.spread > 0 or not math.isfinite(self.spread):
            raise ValueError(f"{self.name}: the spread must be positive and finite, not {self.spread}")
        if not (self.low < self.high and math.isfinite(self.high - self.low) and math.isfinite(self.nominal)):
            raise ValueError(f"{self.name}: no finite range [{self.low}, {self.high}] around {self.nominal}")

    @property
    def usual(self) -> float:
        """The nominal value as a search sets it: within the range, and rounded.

        It is rounded to a whole number if `integer`, otherwise to a thousandth of `spread` or finer.
        """
        return self.sensible(self.nominal)

    def encode(self, value: float) -> float:
        """Return a value's place on the asinh scale, 0 at the nominal value; the value itself if values are few."""
        return value if self.few else math.asinh((value - self.nominal) / self.spread)

    def decode(self, place: float) -> float:
        """Return the value at a place, within the range, rounded to about a thousandth of its distance from nominal."""
        return self.sensible(place if self.few else self.nominal + self.spread * math.sinh(place))

    @property
    def few(self) -> bool:
        """Whether the field has so few whole-number values that they are spaced evenly, not on the asinh scale."""
        return self.integer and self.high - self.low < _FEW

    @property
    def ends(self) -> tuple[float, float]:
        """The places of the smallest and the largest value; almost half a step beyond them if values are few."""
        return (self.low - 0.499, self.high + 0.499) if self.few else (self.encode(self.low), self.encode(self.high))

    def sensible(self, value: float) -> float:
        """Return the value limited to the range and rounded to the digits that make a difference."""
        value = min(max(value, self.low), self.high)
        if self.integer:
            return float(min(max(round(value), math.ceil(self.low)), math.floor(self.high)))
        size = max(abs(value - self.nominal), self.spread)
        return min(max(round(value, _DIGITS - math.floor(math.log10(size))), self.low), self.high)


@dataclass(frozen=True, slots=True)
class Encoding:
    """Points as vectors: each field's asinh scale stretched to [0, 1]."""

    fields: tuple[SearchField, ...]

    @property
    def size(self) -> int:
        """Number of fields."""
        return len(self.fields)

    @property
    def nominal(self) -> Floats:
        """The vector of the nominal point."""
        return self.encode({field.name: field.nominal for field in self.fields})

    def encode(self, point: Mapping[str, float]) -> Floats:
        """Return the vector of a point."""
        places = [(field.encode(point[field.name]), *field.ends) for field in self.fields]
        vector: Floats = np.clip(np.asarray([(place - low) / (high - low) for place, low, high in places]), 0.0, 1.0)
        return vector

    def decode(self, vector: Floats | Sequence[float]) -> dict[str, float]:
        """Return the point of a vector, with sensible values."""
        point = {}
        for field, share in zip(self.fields, vector, strict=True):
            low, high = field.ends
            point[field.name] = field.decode(low + min(max(float(share), 0.0), 1.0) * (high - low))
        return point
