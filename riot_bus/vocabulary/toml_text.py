"""Writing TOML whose texts come from elsewhere, such as the network."""

from __future__ import annotations

__all__ = ["toml_comment", "toml_string"]


def toml_string(value: str) -> str:
    """Return a TOML string."""
    return '"' + "".join(map(_escaped, value)) + '"'


def toml_comment(text: str) -> str:
    """Return text that stays within its comment."""
    return "".join(each if each.isprintable() else "\ufffd" for each in text)


def _escaped(letter: str) -> str:
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"
