"""Run by path in the user's Python: `python3 .../rclpy_node SOCKET NODE_NAME`; the socket is an open descriptor."""

from __future__ import annotations

import importlib.util
import signal
import socket
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def _load() -> None:
    """Make this folder importable as a package of its own, without its sibling modules."""
    if sys.path and Path(sys.path[0] or ".").resolve() == HERE:
        del sys.path[0]
    name = "riot_rclpy_node"
    spec = importlib.util.spec_from_file_location(name, HERE / "__init__.py", submodule_search_locations=[str(HERE)])
    if spec is None or spec.loader is None:
        raise ImportError(f"no package at {HERE}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


def main() -> int:
    """Relay until the other end of the socket is gone."""
    descriptor, node_name = int(sys.argv[1]), sys.argv[2]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # handled by the bridge, which then hangs up
    _load()
    frames = importlib.import_module("riot_rclpy_node.frames")
    wire = frames.Wire(socket.socket(fileno=descriptor))
    try:
        relay = importlib.import_module("riot_rclpy_node.relay").Relay(wire, node_name)
    except Exception as error:
        version = ".".join(map(str, sys.version_info[:2]))
        problem = f"{type(error).__name__}: {error}"
        wire.tell({"event": "unfit", "problem": problem, "python": f"{sys.executable} (Python {version})"})
        wire.flush(10.0)
        wire.close()
        return 1
    relay.run()
    wire.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
