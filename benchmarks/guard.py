"""What a guard costs a message: `python benchmarks/guard.py [--json FILE]`.

Messages go through a pipeline with a guard and, in turn, through one without, as in a router; the difference is the
guard. The rover's map updates (ROS 2) with the paper's rule over two fields, an odometry with a rule of three literals
over three fields, and the same as JSON, which is parsed once for each field; messages for which the rule does not hold,
and ones that are clamped. Microseconds per message: the median of many rounds, once of the processor's time of the
thread, by which the target is judged, and once as the clock says, which tells how busy the machine was.
"""

from __future__ import annotations

import argparse
import json
import logging
import statistics
import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.pipeline.runner import Pipeline
from riot_bus.trial.context import open_system
from riot_bus.vocabulary.message import Message

ROUNDS, BATCH, TARGET_US = 300, 50, 30.0
TARGETS = ("map update, passes", "odometry, passes")
ROVER = Path(__file__).resolve().parents[1] / "examples/rover"
POSITION, SPEED = "pose.pose.position", "twist.twist.linear.x"
ODOMETRY = "0/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"


def mul(*names: str) -> Feature:
    return Feature("mul", names)


def paper() -> Rule:
    product = mul("/map_updates:x", "/map_updates:y")
    return Rule(((Literal(product, "<", 0),), (Literal(product, ">", 4194304),)))


def three(topic: str) -> Rule:
    x, y, speed = (f"{topic}:{path}" for path in (f"{POSITION}.x", f"{POSITION}.y", SPEED))
    far, fast = Literal(Feature("hypot", (x, y)), ">", 100.0), Literal(Feature("raw", (speed,)), ">", 2.5)
    return Rule(((far, fast), (Literal(Feature("nan", (speed,)), "is"),)))


def update(x: int, y: int) -> bytes:
    sys.path.insert(0, str(ROVER))
    from rover.maps import OccupancyGridUpdate

    return OccupancyGridUpdate((1, 2), x, y, 16, 16, bytes(256)).encode()


def odometry(speed: float) -> bytes:
    data = struct.pack("<iII", 1, 2, 5) + b"odom\0" + bytes(3) + struct.pack("<I", 10) + b"base_link\0"
    data += bytes(-len(data) % 8)
    values = [200.0, 30.0, *(0.0,) * 41, speed, *(0.0,) * 41]
    return b"\0\1\0\0" + data + struct.pack("<85d", *values)


def document(speed: float) -> bytes:
    pose = {"pose": {"position": {"x": 200.0, "y": 30.0, "z": 0.0}}, "covariance": [0.0] * 36}
    return json.dumps({"pose": pose, "twist": {"twist": {"linear": {"x": speed, "y": 0.0}}}}).encode()


def cases() -> dict[str, tuple[Rule, str, bytes]]:
    sys.path.insert(0, str(ROVER))
    from rover.topics import key

    maps = key("/map_updates")
    return {
        "map update, passes": (paper(), maps, update(120, 80)),
        "map update, clamped": (paper(), maps, update(4100, 2000)),
        "odometry, passes": (three("/odom"), ODOMETRY, odometry(1.5)),
        "JSON of 400 bytes, passes": (three("odom"), "odom", document(1.5)),
    }


def cost(rule: Rule, key: str, payload: bytes, rounds: int, registry: Any, folder: Path) -> tuple[float, float]:
    """Return the time that a guard takes of the processor and by the clock, in microseconds."""
    path = folder / "rule.json"
    types = dict.fromkeys(rule.variables, "int32" if key.startswith("0/map") else "float64")
    path.write_text(json.dumps({"rule": rule.to_dict(), "types": types}))
    clamped = any(literal.feature.kind == "mul" for term in rule.terms for literal in term)
    guard = RuleGuard(path, "clamp" if clamped else "hold")
    pipelines = [Pipeline(guards, registry=registry, provenance=False) for guards in ((guard,), ())]
    messages = [Message(number, key, payload) for number in range(BATCH)]
    found: list[list[tuple[int, int]]] = [[], []]
    for _ in range(rounds):
        for pipeline, times in zip(pipelines, found, strict=True):
            begin, cpu = time.perf_counter_ns(), time.thread_time_ns()
            for message in messages:
                pipeline.feed(message)
            times.append((time.thread_time_ns() - cpu, time.perf_counter_ns() - begin))
    assert not pipelines[0].errors, pipelines[0].errors
    with_, without = ([statistics.median(each[n] for each in times) for n in (0, 1)] for times in found)
    return tuple((a - b) / BATCH / 1000 for a, b in zip(with_, without, strict=True))  # type: ignore[return-value]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of {BATCH} messages each")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    args = parser.parse_args()
    registry = open_system(ROVER / "riot.toml").registry
    logging.disable()
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (rule, key, payload) in cases().items():
            cpu, wall = figures[name] = cost(rule, key, payload, args.rounds, registry, Path(folder))
            target = f"  (target {TARGET_US:.0f})" if name in TARGETS else ""
            print(f"{name:28}{cpu:8.2f} us, by the clock {wall:8.2f} us{target}")
    if args.json is not None:
        args.json.write_text(json.dumps({name: {"us": us, "clock_us": clock} for name, (us, clock) in figures.items()}))
    missed = [name for name, (cpu, _) in figures.items() if name in TARGETS and cpu > TARGET_US]
    if missed:
        sys.exit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
