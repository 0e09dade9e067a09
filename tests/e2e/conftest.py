"""Running riot as its users do: as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).resolve().parents[2]
Riot = Callable[..., subprocess.CompletedProcess[str]]


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "riot_bus", *map(str, arguments)]


def environment() -> dict[str, str]:
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    return {**os.environ, "PYTHONPATH": paths}


@pytest.fixture
def riot() -> Riot:
    """Run `riot` to its end and return what it said."""

    def run(*arguments: object, timeout: float = 280) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command(*arguments), env=environment(), capture_output=True, text=True, timeout=timeout, check=False
        )

    return run


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
