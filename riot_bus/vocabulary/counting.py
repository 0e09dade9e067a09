"""Counts with a noun, for texts."""

from __future__ import annotations


def counted(count: int, noun: str, *, mark: str = "") -> str:
    """Return `1 message`, `2 messages`, `12345 messages`; a mark separates thousands."""
    return f"{count:,}".replace(",", mark) + f" {noun}{'' if count == 1 else 's'}"
