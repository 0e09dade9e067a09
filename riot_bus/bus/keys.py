"""Key expressions as Zenoh itself compares them."""

from __future__ import annotations

from functools import lru_cache

__all__ = ["intersects"]


@lru_cache(maxsize=65_536)
def intersects(expression: str, other: str) -> bool:
    """Return whether some key is included in both key expressions."""
    import zenoh

    return bool(zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(other)))
