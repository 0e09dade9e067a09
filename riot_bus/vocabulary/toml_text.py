"""Writing of TOML with untrusted texts, such as from the network."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

__all__ = ["toml_key", "toml_string", "toml_value"]

_BARE = re.compile(r"[A-Za-z0-9_-]+")


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
