"""Counts as people write them."""

from __future__ import annotations

__all__ = ["counted"]


def counted(count: int, noun: str, *, mark: str = "") -> str:
    """Return `1 message`, `2 messages`, `12345 messages`.

    Args:
        count: How many there are.
        noun: What, in the singular; its plural has an s more.
        mark: What stands between thousands.
    """
    return f"{count:,}".replace(",", mark) + f" {noun}{'' if count == 1 else 's'}"
