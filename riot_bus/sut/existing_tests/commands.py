"""Commands of which `riot ros-test` knows more than that they are commands: colcon's, and its own."""

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
    """Return how this riot is started again, whatever Python path the environment of the user's ROS has."""
    return [sys.executable, "-E", "-m", "riot_bus"]


def is_colcon_test(command: Sequence[str]) -> bool:
    """Return whether a command is `colcon test`, which runs the tests of many packages."""
    names = [os.path.basename(word) for word in command]
    return "colcon" in names[:3] and "test" in names[names.index("colcon") :]


def router_per_package(
    given: Mapping[str, str], options: Sequence[str], *, folder: Path, accounts: Path
) -> dict[str, str]:
    """Return the variables by which colcon has the tests of each package run by a `riot ros-test` of their own.

    Args:
        given: The variables that colcon has besides.
        options: Those of `riot ros-test`, as they were written.
        folder: For a file; only this user should be able to write there.
        accounts: Where each of them leaves what it has to say.
    """
    plan = folder / "packages.json"
    own = ["--package", "{package}", "--in", "{folder}", "--account", str(accounts), "--"]
    wrap = [*riot_command(), "ros-test", *options, *own]
    plan.write_text(json.dumps({"wrap": wrap, "cwd": str(Path.cwd())}), encoding="utf-8")
    return hooked(given, plan)
