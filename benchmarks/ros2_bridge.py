"""Throughput, bursts and delay of `riot bridge ros2` beside a plain relay node; about three minutes.

python benchmarks/ros2_bridge.py [--json FILE] [--rounds N] [--only PATH ...]

A talker in one ROS domain, a listener in another one, each a process of real ROS 2 (rclpy, Fast DDS over UDP), and
between them either a relay node as one would write it with rclpy (raw, one process), or a bridge, `riot router` and
another bridge (five processes). Beside them a subscription of the same depth in the talker's own domain. In each round
each path is measured once. Needs the packages of the tests, which install ROS 2 where it is missing.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import psutil

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from riot_bus.processes.ros_domains import free_domains  # noqa: E402 - found by the path above
from tests.interop import ROS2, provide  # noqa: E402 - lies beside this folder
from tests.ros2_env import ros2_environment  # noqa: E402 - lies beside this folder

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

PATHS = {
    "direct": "nothing between",
    "relay": "a relay node of rclpy",
    "bridge": "bridge, router, bridge",
    "inject": "the same, injecting",
}
DEPTH = 1000
"""Of all subscriptions on the way, and of the listener that has nothing between; else the listener's is no limit."""
SIZES = (64, 1024, 1 << 16)
WINDOW = 500
"""Messages on their way while throughput is measured, so that none is lost."""
BURSTS = (1000, 10_000)
FLOW_S = 3.0
RATE, PACED = 500.0, 1000
WAIT_S = 30.0
QUIET_S = 4.0
"""Fast DDS asks for what is missing after up to 3 s."""
ENDS = Path(__file__).with_name("ros2_bridge_ends.py")
RIOT = [sys.executable, "-m", "riot_bus"]
PLAN = '[[inject]]\ntopic = "/stream"\nfield = "data"\nvalue = "x"\nwhere = "data == \'never\'"\n'


class Node:
    """A process of `ros2_bridge_ends.py`."""

    def __init__(self, python: Path, environment: Mapping[str, str], role: str, argument: str) -> None:
        self._process = subprocess.Popen(
            [python, ENDS, role, argument], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self._answer()

    def do(self, do: str, **arguments: Any) -> Any:
        """Give an order, and return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, **arguments}) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("a node has ended")
        return json.loads(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()


class Measurement:
    """One path, with a talker before it and a listener behind it.

    Args:
        path: Name of one of `PATHS`.
        python: Has rclpy.
        stack: Ends what is started.
    """

    def __init__(self, path: str, python: Path, stack: ExitStack) -> None:
        self._python, self._stack = python, stack
        self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        domains = stack.enter_context(free_domains(2))
        environments = [ros2_environment(domain, self._folder) for domain in domains]
        before = {each.pid for each in psutil.Process().children(recursive=True)}
        if path == "direct":
            environments[1] = {**environments[0], "DEPTH": str(DEPTH)}
        elif path == "relay":
            stack.enter_context(Node(python, {**environments[0], "DEPTH": str(DEPTH)}, "relay", str(domains[1])))
        else:
            self._bridges(environments, inject=path == "inject")
        children = psutil.Process().children(recursive=True)
        self._between = [each for each in children if each.pid not in before]
        count = self._folder / "count"
        count.write_bytes(bytes(8))
        self.listener = stack.enter_context(Node(python, environments[1], "listener", str(count)))
        self.talker = stack.enter_context(Node(python, environments[0], "talker", str(count)))
        deadline = time.monotonic() + WAIT_S
        while not self.listener.do("reset"):
            if time.monotonic() > deadline:
                raise SystemExit(f"{path}: nothing arrives")
            if self.talker.do("matched"):
                self.talker.do("burst", count=1, size=64)
            time.sleep(0.1)
        time.sleep(1.0)

    def flow(self, size: int) -> dict[str, float]:
        """Return messages per second, how many were lost, and microseconds of all processors for each."""
        before, used, began = self.listener.do("reset"), self._used(), time.monotonic()
        sent = self.talker.do("flow", seconds=FLOW_S, size=size, window=WINDOW)
        report = self._arrived(before + sent)
        count = report["count"] - before
        return {
            "rate": count / (report["last"] - began),
            "lost": sent - count,
            "cpu": 1e6 * (self._used() - used) / max(1, count),
        }

    def burst(self, count: int) -> int:
        """Return how many messages of a burst were lost."""
        before = self.listener.do("reset")
        self.talker.do("burst", count=count, size=64)
        return int(before + count - self._arrived(before + count)["count"])

    def delay(self) -> dict[str, float]:
        """Return the delays at a steady rate, in microseconds."""
        before = self.listener.do("reset")
        self.talker.do("pace", count=PACED, rate=RATE, size=64)
        return self._arrived(before + PACED)

    def _arrived(self, expected: int) -> dict[str, float]:
        """Return what the listener has seen when all is there, or nothing has come for a while."""
        deadline = time.monotonic() + WAIT_S
        while True:
            report: dict[str, float] = self.listener.do("report")
            now = time.monotonic()
            if report["count"] >= expected or now > deadline or now - report["last"] > QUIET_S:
                return report
            time.sleep(0.02)

    def _used(self) -> float:
        times = [each.cpu_times() for each in self._between]
        return sum(each.user + each.system for each in times)

    def _bridges(self, environments: Sequence[Mapping[str, str]], *, inject: bool) -> None:
        plan = self._folder / "plan.toml"
        plan.write_text(PLAN)
        router = [*RIOT, "router", "--format=json", "--segment=a=tcp/127.0.0.1:0", "--segment=b=tcp/127.0.0.1:0"]
        ready = json.loads(self._start([*router, *([f"--inject={plan}"] if inject else [])], os.environ))
        for (endpoint,), environment in zip(ready["endpoints"].values(), environments, strict=True):
            command = [*RIOT, "bridge", "ros2", f"--endpoint={endpoint}", f"--python={self._python}"]
            self._start([*command, f"--depth={DEPTH}"], {**environment, "PYTHONPATH": str(ROOT)})

    def _start(self, command: Sequence[str], environment: Mapping[str, str]) -> str:
        """Start a process that is ended with the stack; return its first line."""
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env={**environment}
        )

        def end() -> None:
            process.terminate()
            process.communicate(timeout=WAIT_S)

        self._stack.callback(end)
        assert process.stdout is not None
        return process.stdout.readline()


def measure(path: str, python: Path) -> dict[str, float]:
    """Return all figures of one path."""
    with ExitStack() as stack:
        measurement = Measurement(path, python, stack)
        found: dict[str, float] = {}
        for size in SIZES:
            found |= {f"{name} {size}": value for name, value in measurement.flow(size).items()}
        for count in BURSTS:
            found[f"burst {count}"] = measurement.burst(count)
        return found | measurement.delay()


def table(rounds: Sequence[Mapping[str, Mapping[str, float]]], paths: Sequence[str]) -> str:
    """Return medians, with lowest and highest, as a table in Markdown."""

    def row(title: str, name: str, form: str, scale: float = 1.0) -> list[str]:
        cells = []
        for path in paths:
            values = [each[path][name] * scale for each in rounds]
            spread = f" ({min(values):{form}} - {max(values):{form}})" if len(values) > 1 else ""
            cells.append(f"{statistics.median(values):{form}}{spread}")
        return [title, *cells]

    rows = [["", *(PATHS[path] for path in paths)]]
    for size in SIZES:
        rows.append(row(f"{size} B: messages/s", f"rate {size}", ",.0f"))
        rows.append(row(f"{size} B: processor time between, us/message", f"cpu {size}", ".0f"))
        rows.append(row(f"{size} B: lost", f"lost {size}", ",.0f"))
    rows += [row(f"lost of a burst of {count:,}", f"burst {count}", ",.0f") for count in BURSTS]
    rows += [row(f"delay at {RATE:.0f} Hz, {name}, ms", name, ".2f", 1e-3) for name in ("p50", "p99")]
    lines = [f"| {' | '.join(each)} |" for each in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="*", choices=PATHS, default=list(PATHS))
    options = parser.parse_args()
    problem = provide(ROS2)
    if problem:
        raise SystemExit(f"ROS 2 cannot be installed: {problem}")
    python = ROS2.entry
    rounds = []
    for number in range(options.rounds):
        rounds.append({path: measure(path, python) for path in options.only})
        print(f"round {number + 1} of {options.rounds}, load {os.getloadavg()[0]:.1f}", file=sys.stderr, flush=True)
    if options.json is not None:
        about = {"machine": platform.machine(), "processors": os.cpu_count(), "rounds": rounds}
        options.json.write_text(json.dumps(about, indent=2) + "\n")
    print(table(rounds, options.only))


if __name__ == "__main__":
    main()
