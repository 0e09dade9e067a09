"""How much of a corpus or a load is tried: a part of it in the gate, all of it by `bootstrap.py test --all`."""

from __future__ import annotations

import os

__all__ = ["ALL", "scaled"]

ALL = bool(os.environ.get("RIOT_ALL_TESTS"))
"""Whether everything is wanted; `bootstrap.py test --all` sets RIOT_ALL_TESTS."""


def scaled(full: int, *, gate: int | None = None) -> int:
    """Return a number of cases, examples or messages: all, or in the gate a quarter (or what `gate` says)."""
    if ALL:
        return full
    return gate if gate is not None else -(-full // 4)
