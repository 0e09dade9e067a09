"""What processes of a test are given so that some of them land in another segment (see `hook/sitecustomize.py`)."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["STARTED", "Placement", "StartedProcesses", "hooked", "only_some", "started_in"]

HOOK = Path(__file__).with_name("hook")
STARTED = ".started"
"""Suffix of the file beside a plan of `only_some` in which the hook tells what was to be started."""
_LARGEST = 1 << 20


@dataclass(frozen=True, slots=True)
class StartedProcesses:
    """What was started, as far as Python has started it: how often each name, by its first name.

    Attributes:
        chosen: In the other segment.
        others: Where the command is.
    """

    chosen: Mapping[str, int]
    others: Mapping[str, int]


class Placement:
    """Puts processes into a segment by their names.

    Args:
        folder: For two files; only this user should be able to write there.
        segment: Segment of the chosen processes.
        nodes: Regular expression for a whole name; None for none.
        variables: What a process of that segment needs.

    Raises:
        ConfigError: It is no regular expression.
    """

    def __init__(self, folder: Path, *, segment: str, nodes: str | None, variables: Mapping[str, str]) -> None:
        try:
            re.compile(nodes or "")
        except re.error as error:
            hint = "such as 'planner|/robot1/controller'"
            raise ConfigError(f"{nodes!r} is no regular expression: {error}", where="--unit-nodes", hint=hint) from None
        self._plan, self._told = folder / "placement.json", folder / "started.jsonl"
        self._told.touch(0o600)
        plan = {"segment": segment, "nodes": nodes or "", "variables": dict(variables), "told": str(self._told)}
        self._plan.write_text(json.dumps(plan), encoding="utf-8")

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """Return the variables by which the hook works, for a process with these."""
        return hooked(given, self._plan)

    def started(self) -> StartedProcesses:
        """Return what was started so far."""
        return started_in(self._told)


def started_in(told: Path) -> StartedProcesses:
    """Return what was started so far, as the hook has told it in a file."""
    found: dict[bool, Counter[str]] = {True: Counter(), False: Counter()}
    with told.open("rb") as stream:
        lines = stream.read(_LARGEST).splitlines()
    for line in lines:
        event = _event(line)
        names = event.get("names")
        if isinstance(names, list) and names:
            found[bool(event.get("segment"))][str(names[-1] if len(names) > 1 else names[0])] += 1
    return StartedProcesses(found[True], found[False])


def hooked(given: Mapping[str, str], plan: Path) -> dict[str, str]:
    """Return the variables by which the hook carries out a plan, for a process with these."""
    path = os.pathsep.join([str(HOOK), *filter(None, [given.get("PYTHONPATH", "")])])
    return {"PYTHONPATH": path, "RIOT_PLACEMENT": str(plan)}


def only_some(given: Mapping[str, str], only: str, *, plan: Path) -> dict[str, str]:
    """Return the variables by which a process starts only some of what it would start.

    Args:
        given: Its variables.
        only: Regular expression for the whole name of what is started.
        plan: A file that is written, in a folder to which only this user should be able to write; what would have been
            started is told in a file beside it.
    """
    told = plan.with_suffix(STARTED)
    told.touch(0o600)
    plan.write_text(json.dumps({"only": only, "told": str(told)}), encoding="utf-8")
    return hooked(given, plan)


def _event(line: bytes) -> dict[str, Any]:
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}
