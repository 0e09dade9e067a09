"""Reproducible noise, the same in every version of Python and without the start-up cost of `random`."""

from __future__ import annotations

from math import cos, log, pi, sqrt

MASK = 2**64 - 1


class Noise:
    """The splitmix64 generator."""

    def __init__(self, seed: int) -> None:
        self._state = seed & MASK

    def unit(self) -> float:
        """Draw evenly from [0, 1)."""
        self._state = mixed = (self._state + 0x9E3779B97F4A7C15) & MASK
        mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9 & MASK
        mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EB & MASK
        return ((mixed ^ (mixed >> 31)) >> 11) / 2**53

    def between(self, low: float, high: float) -> float:
        """Draw evenly from [low, high)."""
        return low + (high - low) * self.unit()

    def normal(self, deviation: float) -> float:
        """Draw from a normal distribution around 0."""
        return deviation * sqrt(-2.0 * log(1.0 - self.unit())) * cos(2.0 * pi * self.unit())
