"""Environment in which a process starts only some of its child processes (see `placement_hook/sitecustomize.py`)."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HOOK = Path(__file__).with_name("placement_hook")
STARTED = ".started"
"""Suffix of the file next to a plan of `only_some` in which the hook reports what was to be started."""


@dataclass(frozen=True, slots=True)
class StartedProcesses:
    """Numbers of processes that Python has started, by name."""

    chosen: Mapping[str, int]
    others: Mapping[str, int]


def started_in(told: Path) -> StartedProcesses:
    """Return what was started so far, according to the hook's file of reports."""
    found: dict[bool, Counter[str]] = {True: Counter(), False: Counter()}
    with told.open("rb") as stream:
        lines = stream.read(1 << 20).splitlines()
    for line in lines:
        event = _event(line)
        names = event.get("names")
        if isinstance(names, list) and names:
            found[bool(event.get("segment"))][str(names[-1] if len(names) > 1 else names[0])] += 1
    return StartedProcesses(found[True], found[False])


def hooked(given: Mapping[str, str], plan: Path) -> dict[str, str]:
    """Return the variables with which the hook carries out a plan in a process with the given variables."""
    path = os.pathsep.join([str(HOOK), *filter(None, [given.get("PYTHONPATH", "")])])
    return {"PYTHONPATH": path, "RIOT_PLACEMENT": str(plan)}


def only_some(given: Mapping[str, str], only: str, *, plan: Path) -> dict[str, str]:
    """Return the variables with which a process starts only some of its child processes.

    Args:
        plan: File to write, in a folder to which only this user should be able to write; a file next to it reports
            what would have been started.
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
