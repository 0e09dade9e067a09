"""`riot ros-test colcon test`: a `riot ros-test` for the tests of each package, and their reports."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.control.log_paths import file_stem
from riot_bus.processes.placement import hooked
from riot_bus.processes.ros_domains import riot_command
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus_bridges.ros_test.placement import HOOK

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

_LARGEST = 1 << 20  # letters; a report has a few lines (`Passage.lines`), so a longer text is not a report


def is_colcon_test(command: Sequence[str]) -> bool:
    """Return whether a command is `colcon test`, which runs the tests of many packages."""
    names = [os.path.basename(word) for word in command]
    return "colcon" in names[:3] and "test" in names[names.index("colcon") :]


def router_per_package(
    given: Mapping[str, str], options: Sequence[str], *, folder: Path, accounts: Path
) -> dict[str, str]:
    """Return the variables that make colcon run the tests of each package under a `riot ros-test` of its own.

    Args:
        given: Other variables that colcon gets.
        options: Options of `riot ros-test`, as the user wrote them.
        folder: Folder to write a file to; only this user should be able to write there.
        accounts: Folder in which each `riot ros-test` leaves its report.
    """
    plan = folder / "packages.json"
    own = ["--package", "{package}", "--in", "{folder}", "--account", str(accounts), "--"]
    wrap = [*riot_command(), "ros-test", *options, *own]
    plan.write_text(json.dumps({"wrap": wrap, "cwd": str(Path.cwd()), "hook": str(HOOK)}), encoding="utf-8")
    return hooked(given, plan)


def leave_account(folder: Path, package: str, lines: Sequence[str], *, vacuous: bool) -> None:
    """Write a report into a folder."""
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
