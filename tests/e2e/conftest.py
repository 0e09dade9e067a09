"""Running riot as its users do: as a process of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest
from e2e_support import command, environment

Riot = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def riot() -> Riot:
    """Run `riot` to its end and return what it said."""

    def run(*arguments: object, timeout: float = 280) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command(*arguments), env=environment(), capture_output=True, text=True, timeout=timeout, check=False
        )

    return run
