"""SVG: elements, texts and the axes of a plot, without styles, so a strict content security policy lets it through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from unicodedata import east_asian_width


def element(tag: str, *content: str, **attributes: float | str) -> str:
    """Return an element with finished ones inside, and attributes with `_` for `-`; numbers are rounded to tenths."""
    given = "".join(
        f' {name.replace("_", "-")}="{escape(one) if isinstance(one, str) else f"{one:.1f}".removesuffix(".0")}"'
        for name, one in attributes.items()
    )
    return f"<{tag}{given}>{''.join(content)}</{tag}>"


def text(words: str, x: float, y: float, *, size: float, fill: str, anchor: str = "middle", **more: str) -> str:
    """Return a line of text; what it says may come from others."""
    return element("text", escape(words), x=x, y=y, font_size=size, fill=fill, text_anchor=anchor, **more)


def width_of(words: str, size: float) -> float:
    """Return about how wide a line of text is in usual fonts, rather more than less."""
    return sum(1.0 if east_asian_width(letter) in "WF" else 0.6 for letter in words) * size


@dataclass(frozen=True, slots=True)
class Axis:
    """Values along one side of a plot.

    Attributes:
        linear: Half width of the linear part of a symlog axis, a power of ten; None for a linear axis.
    """

    low: float
    high: float
    linear: float | None = None

    def share(self, value: float) -> float:
        """Return where a value is: 0.0 at the smallest one, 1.0 at the largest one, others at -1.0 to 2.0."""
        first, last = self._stretched(self.low), self._stretched(self.high)
        return min(max((self._stretched(value) - first) / ((last - first) or 1.0), -1.0), 2.0)

    def _stretched(self, value: float) -> float:
        """Return a value as the axis shows it: on a symlog one, a decade is as long as half of the linear part."""
        if self.linear is None:
            return value
        size = abs(value) / self.linear
        return math.copysign(size if size <= 1 else 1 + math.log10(size), value)

    def ticks(self) -> dict[float, str]:
        """Return round values with their labels."""
        if self.linear is None:
            step = _round_step((self.high - self.low) / 6)
            first, last = math.ceil(self.low / step), math.floor(self.high / step)
            # Enough digits to tell a tick from the next one.
            digits = max(6, math.ceil(math.log10(max(abs(self.low), abs(self.high)) / step)) + 2)
            return {place * step: _label(place * step, digits) for place in range(first, last + 1)}
        lowest = round(math.log10(self.linear))
        highest = max(lowest, math.floor(math.log10(max(abs(self.low), abs(self.high), self.linear))))
        sizes = [10.0**power for power in range(highest, lowest - 1, -max(1, math.ceil((highest - lowest + 1) / 4)))]
        ticks = (*(-size for size in sizes), 0.0, *reversed(sizes))
        return {tick: _label(tick, 6) for tick in ticks if self.low <= tick <= self.high}


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2, 2.5, 3, 4, 5, 6 and 8 times a power of ten that is not less."""
    power = 10.0 ** math.floor(math.log10(least))
    return next((power * factor for factor in (1, 2, 2.5, 3, 4, 5, 6, 8) if power * factor >= least), 10 * power)


def _label(tick: float, digits: int) -> str:
    mantissa, e, power = f"{tick:.{digits - 1}e}".partition("e")
    exact = f"{tick:.{digits}g}"
    if "e" not in exact and abs(tick) < 1e5:
        return exact
    return f"{mantissa.rstrip('0').rstrip('.')}{e}{int(power)}"
