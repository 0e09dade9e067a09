"""Tables in plain text, for terminals."""

from __future__ import annotations

from collections.abc import Container, Sequence


def table_lines(rows: Sequence[Sequence[str]], *, left: Container[int] = (0,)) -> list[str]:
    """Return the lines of a table.

    Args:
        rows: Rows of cells, all of the same length; the first may be the titles of the columns.
        left: Numbers of the columns that are flush left; the others are flush right.
    """
    # else a name of 1 MB would make each of 60,000 rows as wide
    widths = [min(200, max(map(len, column))) for column in zip(*rows, strict=True)]
    forms = [str.ljust if column in left else str.rjust for column in range(len(widths))]
    return [
        "  ".join(form(cell, width) for form, cell, width in zip(forms, row, widths, strict=True)).rstrip()
        for row in rows
    ]
