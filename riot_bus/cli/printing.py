"""Prints results to stdout: lines of text, tables, JSON."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import typer

from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.vocabulary.text_table import table_lines

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from enum import StrEnum

    from rich.console import Console
    from rich.table import Table

_MOST_ROWS = 1000  # of tables that rich lays out: it takes 0.25 s for so many, and 15 s for a log's 60,000 topics


def print_result(form: StrEnum, document: Any, lines: Iterable[str]) -> None:
    """Print a result: with `--format json` as a document, otherwise as lines.

    Args:
        lines: The result as text; a generator is not run for JSON.
    """
    if form == "json":
        print_json(document)
    else:
        print_lines(lines)


def print_lines(lines: Iterable[str]) -> None:
    """Print lines that may contain names from the network, without control characters."""
    for line in lines:
        typer.echo(escape_control_chars(line))


def print_json(document: Any, *, indent: int | None = 1) -> None:
    """Print a document; in one line if `indent` is None."""
    typer.echo(json.dumps(json_safe(document), indent=indent))


def json_safe(value: Any) -> Any:
    """Return a document without what JSON lacks: infinite numbers become text."""
    if isinstance(value, dict):
        return {key: json_safe(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [json_safe(each) for each in value]
    return str(value) if isinstance(value, float) and value - value != 0 else value


def new_table(*texts: str, numbers: Sequence[str] = ()) -> Table:
    """Return an empty table with columns of text, which are folded, and then of numbers, which are aligned right."""
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in texts:
        table.add_column(name, overflow="fold")
    for name in numbers:
        table.add_column(name, justify="right")
    return table


def print_table(table: Table, rows: Iterable[Sequence[str]], *, more: int = 0) -> None:
    """Add rows to a table, without control characters and markup, and print it; plain if they and `more` are many."""
    from rich.markup import escape

    cells = [[escape_control_chars(cell) for cell in row] for row in rows]
    if len(cells) + more > _MOST_ROWS or sum(len(cell) for row in cells for cell in row) > 100 * _MOST_ROWS:
        left = [place for place, column in enumerate(table.columns) if column.justify != "right"]
        print_lines(table_lines([[str(column.header) for column in table.columns], *cells], left=left))
        return
    for row in cells:
        table.add_row(*map(escape, row))
    table_console().print(table)


def table_console() -> Console:
    """Return a console that prints tables to stdout; readers of a file want whole names."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 200, highlight=False, emoji=False)
