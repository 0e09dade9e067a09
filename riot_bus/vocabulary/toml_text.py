"""Writing of TOML with untrusted texts, such as from the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

__all__ = ["toml_string", "toml_value"]


def toml_value(value: object) -> str:
    """Return a TOML value: a string, a boolean, a number, a list, or an inline table whose keys are bare keys."""
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {toml_value(each)}" for name, each in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return repr(value)


def toml_string(value: str) -> str:
    """Return a TOML string."""
    return '"' + "".join(map(_escaped, value)) + '"'


def _escaped(letter: str) -> str:
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"
