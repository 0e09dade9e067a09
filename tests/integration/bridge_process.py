"""A running `riot bridge ros2` in a process of its own."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Self

from tests.integration.router_process import RIOT


class BridgeProcess:
    """The test's end.

    Args:
        python: Interpreter that has rclpy.
        environment: Of `ros2_environment`, whose domain is bridged.
        endpoint: Of the segment.
        options: More of the command's options.
    """

    def __init__(self, python: Path, environment: dict[str, str], endpoint: str, *options: str) -> None:
        self.process = subprocess.Popen(
            [*RIOT, "bridge", "ros2", f"--endpoint={endpoint}", f"--python={python}", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**environment, "PYTHONPATH": str(Path(__file__).parents[2])},
        )
        assert self.process.stdout is not None
        self.ready = self.process.stdout.readline().strip()

    def end(self, number: int = signal.SIGTERM) -> tuple[int, str, str]:
        self.process.send_signal(number)
        return self.outcome()

    def outcome(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate(timeout=60)
