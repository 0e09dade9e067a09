"""Nodes that run the third-party ROS 2 client zenoh-ros2-sdk."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
from pathlib import Path
from typing import Any, Self

ANSWER_S = 60


class RosNode:
    """The test's end of a node.

    Args:
        python: Interpreter that has the SDK.
        endpoint: Of the node's segment.
        environment: Variables that make it use the segment.
        folder: Where it may write.
        name: Name of the ROS node.
    """

    def __init__(self, python: Path, endpoint: str, *, environment: dict[str, str], folder: Path, name: str) -> None:
        foreign = ("ZENOH_", "ROS_", "PYTHON")
        variables = {key: value for key, value in os.environ.items() if not key.startswith(foreign)}
        self._errors = (folder / f"{name}.stderr").open("w+")
        self.process = subprocess.Popen(
            [python, Path(__file__).with_name("ros_node.py"), endpoint.rpartition(":")[2], folder / name, name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            # The SDK looks for definitions that it lacks on GitHub.
            env={**variables, "GIT_ALLOW_PROTOCOL": "file", "ZENOH_ROS2_SDK_CACHE": str(folder), **environment},
        )
        self.zid = self._answer()

    def do(self, do: str, topic: str = "", **arguments: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": do, "topic": topic, **arguments}) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], ANSWER_S)
        line = self.process.stdout.readline() if ready else ""
        assert line, f"node does not answer: {self.errors()}"
        return json.loads(line)

    def errors(self) -> str:
        """Return what it wrote to stderr so far."""
        self._errors.seek(0)
        return self._errors.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.wait(60)
        for pipe in (self.process.stdin, self.process.stdout, self._errors):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
