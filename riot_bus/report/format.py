"""Formatting of values, rates and untrusted texts, for the page and the console alike."""

from __future__ import annotations

import json
import math
import unicodedata
from collections.abc import Mapping
from typing import Any

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars

_SPACES = "".join(chr(code) for code in range(0x3001) if unicodedata.category(chr(code)) == "Zs")
"""Spaces of all widths, which move nothing; U+3000 is the last one."""


def clean(text: str, *, limit: int = 200, lines: bool = False) -> str:
    """Return the text without anything that could move a cursor, reorder a line or flood the reader.

    Args:
        text: Text from a log, a signature or a payload.
        limit: Longest result; the middle is left out.
        lines: Whether to keep line ends and tabs instead of escaping them.
    """
    if len(text) > limit:
        head = (limit * 2) // 3
        tail = max(limit - head - 5, 0)
        text = f"{text[:head]} ... {text[len(text) - tail :]}"
    return escape_control_chars(text, keep=_SPACES + ("\n\t" if lines else ""))


def value(what: Any) -> str:
    """Return a value of a field as exactly as it can be read back."""
    if isinstance(what, str):
        return clean(json.dumps(what, ensure_ascii=False))
    if isinstance(what, Mapping):
        return clean(json.dumps(what, ensure_ascii=False, default=str), limit=600)
    return clean(str(what))


def number(what: float) -> str:
    """Return a measured number, short: integers in full as long as they are exact."""
    if math.isfinite(what) and what == int(what) and abs(what) < 2**53:  # larger ones are not exact
        return str(int(what))
    return f"{what:.3g}" if abs(what) < 1000 else f"{what:.6g}"


def share(rate: float) -> str:
    """Return a rate in percent; only exact values are written as 0 % or 100 %."""
    percent = 100 * rate
    if not math.isfinite(percent) or percent in (0.0, 100.0):
        return f"{percent:.0f} %"
    if percent > 99.95 or 0 < percent < 0.05:
        return "> 99.9 %" if percent > 50 else "< 0.1 %"
    return f"{percent:.1f} %" if percent > 99 or percent < 10 else f"{percent:.0f} %"


def share_interval(low: float, high: float) -> str:
    """Return an interval of a rate in percent."""
    return f"{share(low).removesuffix(' %')} to {share(high)}"


def plural(count: int, noun: str) -> str:
    """Return `1 message`, `2 messages`, `12 345 messages`."""
    return counted(count, noun, mark="\N{NO-BREAK SPACE}")


def seconds(duration: float) -> str:
    """Return a duration as human-readable text."""
    if not math.isfinite(duration):
        return "?"
    if duration < 60:
        return f"{duration:.1f} s" if duration < 10 else f"{duration:.0f} s"
    minutes, rest = divmod(round(duration), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"
