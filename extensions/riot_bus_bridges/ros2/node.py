"""The ROS node of a bridge: a process that runs in the user's own Python and is controlled from here."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_bridges import rclpy_node
from riot_bus_bridges.rclpy_node.frames import BridgeFrame, BridgeFrameKind, Wire

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_bridges.ros2.options import Ros2BridgeOptions

_PROGRAM = Path(rclpy_node.__file__).resolve().parent
START_S = 60.0
"""Generous: importing rclpy, and discovery, on a slow or busy machine; not measured."""
_END_S = 10.0  # the node itself takes up to 6 s: three times `_LINGER_S` of relay.py
_SOURCE = 'source "$0" && exec "$@"'


class NodeProcess:
    """Process of the node; call `start` once and `close` always."""

    def __init__(self, name: str, options: Ros2BridgeOptions, received: Callable[[BridgeFrame | None], None]) -> None:
        self._name, self._options, self._received = name, options, received
        self._process: subprocess.Popen[bytes] | None = None
        self._wire: Wire | None = None
        self._thread = threading.Thread(target=self._receive, name="riot-bridge-node", daemon=True)

    def start(self) -> dict[str, Any]:
        """Start the process; return its first report. Raises ConfigError without rclpy, else EnvironmentFaultError."""
        ours, theirs = socket.socketpair()
        for each in (ours, theirs):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 22)
        python = self._options.python or interpreter()
        command = [python, str(_PROGRAM), str(theirs.fileno()), self._name]
        if self._options.setup is not None:
            command = ["bash", "-c", _SOURCE, str(self._options.setup.resolve()), *command]
        with theirs:
            self._wire = Wire(ours)
            try:
                self._process = subprocess.Popen(
                    command,
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=sys.stderr.fileno(),  # ROS may write to it; ours is for results
                    env={**os.environ, "ROS_DOMAIN_ID": str(self._options.domain)},
                )
            except OSError as error:
                raise ConfigError(f"{command[0]} does not start: {error.strerror}", where="--python") from error
        ours.settimeout(START_S)
        first = self._wire.receive()
        ours.settimeout(None)
        if first is None:
            text = f"the node of the bridge does not start in {python}"
            raise EnvironmentFaultError(text, where="bridge", hint="what ROS says about it stands above")
        said = first.document()
        if said["event"] == "unfit":
            hint = "source /opt/ros/<distribution>/setup.bash before, or name it (--setup), or name --python"
            raise ConfigError(f"no rclpy in {said['python']}: {said['problem']}", where="--python", hint=hint)
        self._thread.start()
        return said

    def tell(self, **order: Any) -> None:
        """Send an order; do nothing if the process has ended, which is detected elsewhere."""
        self._send(lambda wire: wire.tell(order))

    def send(self, kind: BridgeFrameKind, endpoint: int, number: int, payload: bytes) -> None:
        """Send a message, request, response or failure."""
        self._send(lambda wire: wire.send(kind, endpoint, number, payload))

    def finish(self) -> None:
        """Let the process send what has already arrived from the domain, and end; wait for that for a limited time."""
        if self._thread.is_alive():
            self.tell(do="end")
            self._thread.join(_END_S)

    def close(self) -> None:
        """End the process, after what was sent to it before; safe to call twice."""
        if self._wire is not None:
            self._wire.flush(5.0)
            self._wire.hang_up()
        if self._process is not None:
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()
        if self._wire is not None:
            self._wire.close()
            self._wire = None

    def _send(self, do: Callable[[Wire], None]) -> None:
        wire = self._wire
        if wire is not None:
            try:
                do(wire)
            except OSError:
                wire.hang_up()

    def _receive(self) -> None:
        wire = self._wire
        while wire is not None and (frame := wire.receive()) is not None:
            self._received(frame)
        self._received(None)


def interpreter() -> str:
    """Return the Python that most probably has rclpy: this one, else the first other one on PATH."""
    spec = find_spec("rclpy")
    here = f"python{sys.version_info.major}.{sys.version_info.minor}"
    if spec is not None and spec.origin is not None and here in spec.origin:
        return sys.executable
    own = Path(sys.prefix, "bin")
    folders = [each for each in os.environ.get("PATH", os.defpath).split(os.pathsep) if each and Path(each) != own]
    return shutil.which("python3", path=os.pathsep.join(folders)) or "python3"
