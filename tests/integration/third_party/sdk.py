"""The third-party ROS 2 client zenoh-ros2-sdk: installed once into an environment of its own, and nodes that run it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Self

PACKAGE = "zenoh-ros2-sdk==0.1.8"
INSTALL_S = 200
ANSWER_S = 30


def install() -> tuple[Path | None, str]:
    """Return the interpreter of an environment that has the SDK, else why there is none; processes take turns."""
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    folder = Path(tempfile.gettempdir()) / f"riot-bus-{PACKAGE.replace('==', '-')}-{python}-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        return None, f"{folder} belongs to somebody else"
    interpreter, complete = folder / "venv/bin/python", folder / "complete"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if complete.exists() and interpreter.exists():
            return interpreter, ""
        for command in (
            [sys.executable, "-m", "venv", "--clear", str(folder / "venv")],
            [str(interpreter), "-m", "pip", "install", "--quiet", "--retries=1", "--only-binary=:all:", PACKAGE],
            [str(interpreter), "-c", "import zenoh_ros2_sdk"],  # needs git
        ):
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
            except subprocess.TimeoutExpired:
                return None, f"{' '.join(command[1:4])} took over {INSTALL_S} s"
            if done.returncode:
                lines = [line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("WARNING")]
                return None, f"{' '.join(command[1:4])}: {lines[-1] if lines else done.returncode}"
        complete.touch()
    return interpreter, ""


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
        self.process.wait(10)
        for pipe in (self.process.stdin, self.process.stdout, self._errors):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
