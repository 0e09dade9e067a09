"""Forms in which a finding is reported: what one is, and how it is written to a file.

Forms of others are found by the entry points `riot_bus.reports`; `riot_bus.testing.reports` tests them.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Protocol

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.report.finding_view import FindingView

__all__ = ["ReportFormat", "write_file"]


class ReportFormat(Protocol):
    """Makes a report of one finding; a class without arguments.

    Attributes:
        file: Name of the file in the finding's folder that it is written to; empty for stdout.
    """

    file: str

    def render(self, view: FindingView) -> str | bytes:
        """Return the report; texts in the view come from others, and may hold anything.

        Raises:
            MissingExtraError: An optional dependency is not installed.
        """
        ...


def write_file(content: str | bytes, path: Path) -> Path:
    """Write a report in one move, so that a reader never sees half of it; return its path.

    Raises:
        ConfigError: It cannot be written there.
    """
    partial = path.with_name(f"{path.name}.partial")
    try:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(partial, path)
    except OSError as error:
        raise ConfigError(f"cannot write the report: {error.strerror}", where=str(path)) from error
    return path
