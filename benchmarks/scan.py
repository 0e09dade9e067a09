"""How long `riot scan` takes for a log of a million messages, and how long the log takes to be read alone.

Usage: python benchmarks/scan.py [--messages N] [--json FILE]

The rule reads one field of each of two topics; the log has two topics of `geometry_msgs/msg/Twist` by turns. Beside it
runs what one would write otherwise: the `mcap` package and one field after the other in Python.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import sys
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader

from riot_bus.findings.records import ProportionRecord, RuleRecord
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.log.tables.table import columns
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.scan import Scanner, ScanRule

TYPE, BEGIN, STEP = "geometry_msgs/msg/Twist", 1_700_000_000 * 10**9, 10**6
NAMES = ("/a:linear.x", "/b:linear.x")
HEAD = b"\x00\x01\x00\x00"


def value(number: int) -> float:
    """Return what a message says."""
    return math.sin(number / 1000) + number % 7 / 100


def write_log(path: Path, messages: int) -> None:
    """Write messages of two topics by turns."""
    registry = TypeRegistry(load_adapters(), declared={"/a": TYPE, "/b": TYPE})
    with LogWriter(path, registry=registry) as log:
        for number in range(messages):
            payload = HEAD + struct.pack("<6d", value(number), 0, 0, 0, 0, 0)
            log.write(Message(BEGIN + number * STEP, "/ab"[0] + "ab"[number % 2], payload, encoding="cdr"))


def write_rule(folder: Path) -> RuleRecord:
    """Write a rule that the log comes near to and never meets."""
    rule = Rule(((Literal(Feature("add", NAMES), ">", 2.2),),))
    share = ProportionRecord(value=1.0, low=0.9, high=1.0, count=9, total=9)
    record = RuleRecord(
        text=rule.text(),
        rule=rule.to_dict(),
        precision=share,
        recall=share,
        balanced_accuracy=1.0,
        scale=dict.fromkeys(NAMES, 0.7),
    )
    record.save(folder)
    return record


def by_hand(path: Path) -> float:
    """Return the least distance, read message by message."""
    latest: dict[str, float] = {}
    least = math.inf
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            (latest[channel.topic],) = struct.unpack_from("<d", message.data, 4)
            if len(latest) == 2:
                least = min(least, (2.2 - sum(latest.values())) / 0.7)
    return least


def main() -> None:
    """Measure and print a line for each way, of three runs the median."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, path = Path(name), Path(name) / "log.mcap"
        write_log(path, options.messages)
        write_rule(folder)
        ways = {
            "riot scan": lambda: Scanner(ScanRule(folder)).scan(path).distance,
            "its columns alone": lambda: len(columns(path, list(NAMES))),
            "message by message": lambda: by_hand(path),
        }
        figures: dict[str, dict[str, float]] = {}
        for _ in range(3):
            for way, run in ways.items():
                begin = time.perf_counter()
                told = run()
                figures.setdefault(way, {})[str(len(figures.get(way, {})))] = time.perf_counter() - begin
                print(f"{way}: {time.perf_counter() - begin:.2f} s ({told:.4g})", file=sys.stderr)
    medians = {way: sorted(some.values())[1] for way, some in figures.items()}
    for way, seconds in medians.items():
        print(f"{way:20} {seconds:6.2f} s  {options.messages / seconds:12,.0f} messages/s")
    if options.json:
        options.json.write_text(json.dumps({"messages": options.messages, "seconds": medians}, indent=1))


if __name__ == "__main__":
    main()
