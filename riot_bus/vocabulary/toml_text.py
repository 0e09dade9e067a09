"""Reading and writing of TOML with untrusted texts, such as from the network."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from riot_bus.vocabulary.errors import ConfigError

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_MOST_PARTS = 16
"""Most parts of a dotted key: the longest of Zenoh's settings has 12 in riot.toml. Python's parser takes the square of
their number in time (`a.a.a...` of 48 kB: 12 s), and with 16 at most 5 s for each MiB."""
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w\\-])(?:{_PART}\.[ \t]*+){{{_MOST_PARTS}}}", re.ASCII)
"""A longer key; it begins at no backslash, so no part of a text is read more than `_MOST_PARTS` times."""
_LONG_INTEGER = re.compile(r"(?<![\w\"'])0[xob]\w{1025}")
"""An integer above the 4,096 bits of formulas; beyond 4,300 decimal digits, Python refuses to show one."""


def parse_toml(text: str, *, where: str) -> dict[str, Any]:
    """Return the document of a TOML text of anybody, in a time that grows with its length.

    Raises:
        ConfigError: It is not TOML, or holds a key of too many parts or an integer of too many digits.
    """
    import tomllib

    long = _LONG_KEY.search(text) or _LONG_INTEGER.search(text)
    if long is not None:
        place = f"{where}:{text.count(chr(10), 0, long.start()) + 1}"
        hint = f"a key has at most {_MOST_PARTS} parts, and an integer 1,024 digits"
        raise ConfigError(f"{long[0][:40]!r}... is too long", where=place, hint=hint)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        problem = str(error).partition("; use")[0]  # of Python's, which advises programmers
        raise ConfigError(f"not a TOML file: {problem}", where=where) from None


def toml_value(value: object) -> str:
    """Return a TOML value: a string, a boolean, a number, a list, or an inline table."""
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        pairs = (f"{toml_key(name)} = {toml_value(each)}" for name, each in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return repr(value)


def toml_key(name: str) -> str:
    """Return a key of a TOML table, in quotes where it needs them."""
    return name if _BARE.fullmatch(name) else toml_string(name)


def toml_string(value: str) -> str:
    """Return a TOML string."""
    return '"' + "".join(map(_escaped, value)) + '"'


def _escaped(letter: str) -> str:
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"
