"""Commands that `riot ros-test` treats specially: `colcon test` and its own."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.sut.existing_tests.placement import hooked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["is_colcon_test", "riot_command", "router_per_package"]


def riot_command() -> list[str]:
    """Return the command that starts this same riot again, whatever `PYTHONPATH` the user's ROS environment sets."""
    return [sys.executable, "-E", "-m", "riot_bus"]


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
    plan.write_text(json.dumps({"wrap": wrap, "cwd": str(Path.cwd())}), encoding="utf-8")
    return hooked(given, plan)
