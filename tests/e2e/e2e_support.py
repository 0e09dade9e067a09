"""riot as a process of its own, and the processes that it leaves or does not leave."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import psutil

ROOT = Path(__file__).resolve().parents[2]


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "riot_bus", *map(str, arguments)]


def environment() -> dict[str, str]:
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    return {**os.environ, "PYTHONPATH": paths}


def belonging_to(folder: Path) -> list[psutil.Process]:
    """Return the live processes that name a folder, or run in it, or were started by such a one."""
    found = []
    for process in psutil.process_iter():
        try:
            words = [*process.cmdline(), process.cwd()]
            if process.status() != psutil.STATUS_ZOMBIE and any(str(folder) in word for word in words):
                found.append(process)
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found
