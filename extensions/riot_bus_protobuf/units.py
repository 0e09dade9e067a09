"""Recognition of units of measurement in comments of definitions and descriptions of schemas."""

from __future__ import annotations

import re

# Symbol -> words for it. Symbols are case-sensitive, words are not.
_WORDS = {
    "m": "metre metres meter meters",
    "mm": "millimetre millimetres millimeter millimeters",
    "cm": "centimetre centimetres centimeter centimeters",
    "km": "kilometre kilometres kilometer kilometers",
    "s": "sec second seconds",
    "ms": "msec millisecond milliseconds",
    "us": "usec microsecond microseconds",
    "ns": "nsec nanosec nanosecond nanoseconds",
    "min": "minute minutes",
    "h": "hour hours",
    "rad": "radian radians",
    "deg": "degree degrees",
    "m/s": "m/sec mps",
    "m/s^2": "m/s/s m/s2 m/s² m/sec^2",
    "rad/s": "rad/sec radians/s radians/sec",
    "rad/s^2": "rad/s/s rad/s2 rad/s² rad/sec^2",
    "deg/s": "deg/sec degrees/s degrees/sec",
    "km/h": "kph",
    "Hz": "hertz",
    "kHz": "kilohertz",
    "MHz": "megahertz",
    "rpm": "",
    "kg": "kilogram kilograms",
    "g": "",
    "N": "newton newtons",
    "Nm": "N·m N*m N-m",
    "Pa": "pascal pascals",
    "hPa": "hectopascal hectopascals",
    "bar": "",
    "J": "joule joules",
    "W": "watt watts",
    "Wh": "",
    "V": "volt volts",
    "mV": "millivolt millivolts",
    "A": "ampere amperes amp amps",
    "mA": "",
    "Ah": "",
    "mAh": "",
    "ohm": "ohms",
    "T": "tesla teslas",
    "lx": "lux",
    "K": "kelvin",
    "degC": "celsius °C",
    "%": "percent",
    "dB": "",
    "dBm": "",
    "px": "pixel pixels",
    "byte": "bytes",
    "bit": "bits",
}
_UNITS = {word.lower(): symbol for symbol, words in _WORDS.items() for word in words.split()} | {
    "degree celsius": "degC",
    "degrees celsius": "degC",
    "deg c": "degC",
}
_AFTER_IN = frozenset(_WORDS) - {"g", "h", "N", "J", "W", "V", "A", "T", "K", "bit", "bar", "min"}
"""Symbols that cannot be other words after `in`."""
_MOST_TEXT = 4096  # a guess, some fifty lines: bounds the search in comments, which logs bring along
_BRACKETS = re.compile(r"\[([^\[\]]{1,20})\]|\(([^()]{1,20})\)")
_NAMED = re.compile(r"\bunits?\s?[:=]\s?([^\s,;]{1,20})", re.IGNORECASE)
_IN = re.compile(r"\bin (degrees celsius|[^\s,;()\[\]]{1,20})", re.IGNORECASE)


def unit_in(comment: str) -> str:
    """Return the unit that a comment on a field names, empty if it names none or several.

    The forms `[m/s]`, `(rad)`, `unit: Hz` and `in metres` are recognised, in this order.

    >>> unit_in("start angle of the scan [rad]")
    'rad'
    >>> unit_in("Voltage in Volts (Mandatory)")
    'V'
    """
    comment = comment[:_MOST_TEXT]
    for form, symbols in ((_BRACKETS, _WORDS.keys()), (_NAMED, _WORDS.keys()), (_IN, _AFTER_IN)):
        words = (next(filter(None, match.groups())) for match in form.finditer(comment))
        bare = (word.strip(" .'\"") for word in words)
        found = {word if word in symbols else _UNITS.get(word.lower(), "") for word in bare} - {""}
        if found:
            return found.pop() if len(found) == 1 else ""
    return ""
