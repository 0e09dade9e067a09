"""Environment of a test's processes that puts some of them into another segment (see `hook`)."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.processes.placement import StartedProcesses, hooked, started_in
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

HOOK = Path(__file__).with_name("hook.py")
"""File that a plan names, so that the core's hook loads it."""


class Placement:
    """Puts processes into a segment by their names.

    Args:
        folder: Folder for two files; only this user should be able to write there.
        segment: Segment of the chosen processes.
        nodes: Regular expression for a whole name; None for none.
        variables: Environment variables that a process of that segment needs.

    Raises:
        ConfigError: `nodes` is not a regular expression.
    """

    def __init__(self, folder: Path, *, segment: str, nodes: str | None, variables: Mapping[str, str]) -> None:
        try:
            re.compile(nodes or "")
        except re.error as error:
            hint = "such as 'planner|/robot1/controller'"
            text = f"{nodes!r} is not a regular expression: {error}"
            raise ConfigError(text, where="--unit-nodes", hint=hint) from None
        self._plan, self._told = folder / "placement.json", folder / "started.jsonl"
        self._told.touch(0o600)
        plan = {"segment": segment, "nodes": nodes or "", "variables": dict(variables), "told": str(self._told)}
        plan["hook"] = str(HOOK)
        self._plan.write_text(json.dumps(plan), encoding="utf-8")

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """Return the variables that activate the hook in a process with the given variables."""
        return hooked(given, self._plan)

    def started(self) -> StartedProcesses:
        """Return what was started so far."""
        return started_in(self._told)
