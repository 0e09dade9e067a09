"""Logs, which are MCAP files: writer, reader, player, and fields as arrays.

`columns` and `iter_columns` are available here; they are only imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus.log.tables.table import Column, Columns, columns, iter_columns

__all__ = ["Column", "Columns", "columns", "iter_columns"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from riot_bus.log.tables import table

    return getattr(table, name)
