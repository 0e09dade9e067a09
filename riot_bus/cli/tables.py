"""What commands that print tables or JSON share."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["json_safe", "table_console"]

_COLUMNS = 200  # if stdout is not a terminal: readers of a file want whole names


def json_safe(value: Any) -> Any:
    """Return a document without what JSON lacks: infinite numbers become text."""
    if isinstance(value, dict):
        return {key: json_safe(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [json_safe(each) for each in value]
    return str(value) if isinstance(value, float) and value - value != 0 else value


def table_console() -> Console:
    """Return a console that prints tables to stdout."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _COLUMNS, highlight=False, emoji=False)
