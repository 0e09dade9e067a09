"""Reports of the `riot ros-test` of each package, collected by the one that runs all packages."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from riot_bus.control.log_paths import file_stem
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

__all__ = ["leave_account", "package_lines"]

_LARGEST = 1 << 20  # letters; a report has a few lines (`Passage.lines`), so more is no report


def leave_account(folder: Path, package: str, lines: Sequence[str], *, vacuous: bool) -> None:
    """Write a report into a folder.

    Args:
        folder: Folder that the report is written to.
        package: Name of the tested package.
        lines: Lines of the report.
        vacuous: Whether the results say nothing about what was asked for.
    """
    text = json.dumps({"package": package, "lines": list(lines), "vacuous": vacuous})
    (folder / f"{file_stem(package)}-{os.getpid()}.json").write_text(text, encoding="utf-8")


def package_lines(folder: Path) -> list[str]:
    """Return the lines for all packages, and a summary that stresses the packages that have shown nothing."""
    found: list[dict[str, Any]] = []
    for path in sorted(folder.glob("*.json")):
        with path.open(encoding="utf-8") as stream:
            found.append(json.loads(stream.read(_LARGEST)))
    if not found:
        return ["NO TESTS OF A PACKAGE WENT THROUGH A ROUTER: colcon has started none by ctest, pytest or unittest"]
    vacuous = [each["package"] for each in found if each["vacuous"]]
    lines = [f"{each['package']}: {line}" for each in found for line in each["lines"]]
    told = f"; NOTHING SHOWN by {', '.join(vacuous)}" if vacuous else ""
    lines.append(f"tests of {counted(len(found), 'package')}, each through a router of its own{told}")
    return [escape_control_chars(line) for line in lines]
