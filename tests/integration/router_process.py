"""A running `riot router` in a process of its own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

RIOT = [sys.executable, "-m", "riot_bus"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


class RouterProcess:
    """The test's end.

    Args:
        arguments: Options.
        endpoints: Where segments listen, by name; by default two on ports of the system's choice.
        cwd: Working folder.
        environment: Further variables.

    Raises:
        AssertionError: It ended before it was ready.
    """

    def __init__(
        self,
        *arguments: str,
        endpoints: dict[str, str] | None = None,
        cwd: Path | str | None = None,
        segments: bool = True,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        asked = endpoints or dict.fromkeys(("system", "unit"), "tcp/127.0.0.1:0")
        named = [f"--segment={name}={endpoint}" for name, endpoint in asked.items()] if segments else []
        self.process = subprocess.Popen(
            [*RIOT, "router", *named, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**ENVIRONMENT, **(environment or {})},
            cwd=cwd,
        )
        assert self.process.stdout is not None
        self.ready = self.process.stdout.readline().strip()
        assert self.ready, self.process.communicate(timeout=60)
        self.endpoints = _endpoints(self.ready)

    def end(self, number: int) -> tuple[int, str, str]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate(timeout=60)


def _endpoints(ready: str) -> dict[str, str]:
    """Return where each segment listens first, by name, from what a router says when it is ready, as text or JSON."""
    if ready.startswith("{"):
        return {name: str(found[0]) for name, found in json.loads(ready)["endpoints"].items()}
    return dict(re.findall(r"segment (\S+) (\w+/[^\s,;]+)", ready))


def riot(
    *arguments: str, cwd: Path | str | None = None, environment: Mapping[str, str] | None = None
) -> tuple[int, str, str]:
    """Run a command to its end; return exit code, stdout and stderr."""
    variables = {**ENVIRONMENT, **(environment or {})}
    done = subprocess.run(
        [*RIOT, *arguments], capture_output=True, text=True, timeout=120, env=variables, cwd=cwd, check=False
    )
    return done.returncode, done.stdout, done.stderr


def failing(arguments: Sequence[str]) -> tuple[int, str]:
    """Run `riot router` with options that it refuses; return exit code and stderr."""
    code, _, err = riot("router", *arguments)
    return code, err
