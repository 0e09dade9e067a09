"""Two ends of MAVLink and what is between them: nothing, or riot."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess
from tests.mavlink_env import mavlink_environment

HERE = Path(__file__).parent
PATIENCE = 90
BETWEEN = ("nothing", "native", "intercepted", "own router", "own router, intercepted")


class Stand:
    """Starts what is between, then an autopilot, then a ground station; a context manager.

    Args:
        python: Interpreter of the ends.
        folder: For their files.
        between: One of `BETWEEN`.

    Attributes:
        air: pymavlink's address for the autopilot.
        ground: That for the ground station, which listens.
    """

    def __init__(self, python: Path, folder: Path, between: str) -> None:
        self.python, self.folder = python, folder
        self.environment = mavlink_environment(folder)
        self._stack = ExitStack()
        port = _free_port()
        self.ground = self.air = f"udpin:127.0.0.1:{port}"
        self.bridge: subprocess.Popen[str] | None = None
        try:
            if between != "nothing":
                self._between(port, alone=between.startswith("own"), intercepted=between.endswith("intercepted"))
        except BaseException:
            self._stack.close()
            raise
        self.air = self.air.replace("udpin", "udpout")

    def _between(self, port: int, *, alone: bool, intercepted: bool) -> None:
        options = ["--intercept=mavlink_raw/**"] if intercepted else []
        if alone:
            looking = [f"--interceptor=record path={self.folder / 'seen.mcap'}"] if intercepted else []
            listen = ["--listen=system=tcp/127.0.0.1:0", "--listen=unit=tcp/127.0.0.1:0"]
            segments = [*options, *looking, *listen]
        else:
            router = self._stack.enter_context(RouterProcess(*options))
            segments = [f"--segment={name}={endpoint}" for name, endpoint in router.endpoints.items()]
        links = ["--link=system/air=udpin:127.0.0.1:0", f"--link=unit/ground=udpout:127.0.0.1:{port}"]
        self.bridge = subprocess.Popen(
            [*RIOT, "bridge", "mavlink", *segments, *links, "--format=json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
        self._stack.callback(_kill, self.bridge)
        assert self.bridge.stdout is not None
        ready = self.bridge.stdout.readline()
        try:
            self.air = f"udpout:{json.loads(ready)['links']['air']['where']}"
        except ValueError:
            raise AssertionError(ready) from None

    def start(self, *command: str) -> subprocess.Popen[str]:
        """Start an end with this interpreter."""
        process = subprocess.Popen(
            [str(self.python), *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self.folder,
            env=self.environment,
        )
        self._stack.callback(_kill, process)
        return process

    def autopilot(self, *options: str) -> subprocess.Popen[str]:
        """Start the scripted autopilot."""
        return self.start("-m", "drone.autopilot", f"--connect={self.air}", *options)

    def report(self, program: str, url: str) -> dict[str, Any]:
        """Run a ground station to its end; return what it reports."""
        process = self.start(str(HERE / program), url)
        out, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, out + err
        found: dict[str, Any] = json.loads(out.splitlines()[-1])
        return found

    def status(self) -> dict[str, Any]:
        """End the bridge; return what it says of what crossed."""
        assert self.bridge is not None
        self.bridge.send_signal(signal.SIGTERM)
        out, err = self.bridge.communicate(timeout=PATIENCE)
        assert self.bridge.returncode == 0, out + err
        found: dict[str, Any] = json.loads(out.splitlines()[0])  # its own router's counts follow
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()


def losses(process: subprocess.Popen[str]) -> dict[str, tuple[int, int]]:
    """End a program of the example; return how many messages it has received and lost, by their source."""
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, out + err
    rows = re.findall(r"from (\S+): (\d+) received, (\d+) lost", out)
    return {source: (int(received), int(lost)) for source, received, lost in rows}


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _kill(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.communicate(timeout=PATIENCE)
