"""Measures how late messages were, as a histogram of constant size."""

from __future__ import annotations

from collections import Counter

_BITS = 7  # leading bits: values are exact to 2**-6, or 1.6 %


class Lateness:
    """Counts delays; quantiles are exact to 1.6 %, the worst one to the nanosecond."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[int, int]] = Counter()
        self._worst = 0
        self.count = 0

    def add(self, nanoseconds: int) -> None:
        """Count one delay; a negative one counts as 0."""
        if nanoseconds > self._worst:
            self._worst = nanoseconds
        elif nanoseconds < 0:
            nanoseconds = 0
        shift = max(0, nanoseconds.bit_length() - _BITS)
        self._counts[shift, nanoseconds >> shift] += 1
        self.count += 1

    @property
    def worst(self) -> float:
        """The longest delay in seconds."""
        return self._worst / 1e9

    def quantile(self, share: float) -> float:
        """Return the delay in seconds that this share of the messages does not exceed; 0 if there are none."""
        left = share * self.count
        found = 0
        for (shift, head), number in sorted(self._counts.copy().items()):
            found = (head + 1 << shift) - 1
            left -= number
            if left <= 0:
                break
        return min(found, self._worst) / 1e9
