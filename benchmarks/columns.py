"""Messages per second of `columns` beside the mcap reader with a decoder: `python benchmarks/columns.py [--json]`.

One float field of nav_msgs/Odometry, from a log of 1,000,000 messages. The peers decode each message with
mcap-ros2-support, and with rosbags, and read the first 100,000 of the same file, since they take so long. Each runs in
a process of its own, so that its memory is its own too.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message

TYPE = "nav_msgs/msg/Odometry"
TOPIC, FIELD = "/odom", "twist.twist.linear.x"
SELECTOR = f"{TOPIC}:{FIELD}"
MEMORY = 256 << 20
SHORT = 100
BEGIN = 10**18


def payloads(count: int) -> list[bytes]:
    """Return payloads whose numbers are random, as those of a moving robot are about."""
    rng = random.Random(0)
    found = []
    for number in range(count):
        head = struct.pack("<iI", number, number) + struct.pack("<I", 5) + b"odom\0" + bytes(3)
        head += struct.pack("<I", 10) + b"base_link\0"
        head += bytes(-len(head) % 8)
        pose = [rng.random() for _ in range(7)] + [0.0] * 36
        twist = [rng.random(), 0.0, 0.0, 0.0, 0.0, rng.random()] + [0.0] * 36
        found.append(b"\0\1\0\0" + head + struct.pack("<85d", *pose, *twist))
    return found


def make_log(path: Path, count: int, compression: str) -> None:
    registry = TypeRegistry(load_adapters(), declared={TOPIC: TYPE})
    bodies = payloads(min(count, 20_000))
    with LogWriter(path, LogSettings(compression=compression), registry=registry, profile="ros2") as writer:
        for number in range(count):
            writer.write(Message(BEGIN + number * 10**6, TOPIC, bodies[number % len(bodies)], sequence=number))


def ours(path: Path, count: int) -> float:
    from riot_bus.log import columns

    found = columns(path, [SELECTOR], memory=MEMORY, end=BEGIN + count * 10**6)[SELECTOR]
    assert len(found) == count
    assert found.valid.all()
    return float(found.values.sum())


def ours_in_pieces(path: Path, count: int) -> float:
    from riot_bus.log import iter_columns

    parts = iter_columns(path, [SELECTOR], memory=MEMORY, end=BEGIN + count * 10**6)
    return float(sum(part[SELECTOR].values.sum() for part in parts))


def mcap_ros2(path: Path, count: int) -> float:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    total = 0.0
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for each in islice(reader.iter_decoded_messages(topics=[TOPIC]), count):
            total += each.decoded_message.twist.twist.linear.x
    return total


def rosbags(path: Path, count: int) -> float:
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    store, total = get_typestore(Stores.ROS2_KILTED), 0.0
    with path.open("rb") as file:
        for _, _, message in islice(make_reader(file).iter_messages(topics=[TOPIC]), count):
            total += store.deserialize_cdr(message.data, TYPE).twist.twist.linear.x  # type: ignore[attr-defined]
    return total


READERS: dict[str, Callable[[Path, int], float]] = {
    "riot_bus columns": ours,
    "riot_bus iter_columns": ours_in_pieces,
    "mcap + mcap-ros2-support": mcap_ros2,
    "mcap + rosbags": rosbags,
}


def run_one(name: str, path: Path, count: int) -> None:
    """Read the log once, after a short one that pays for imports, and print seconds, the sum and the peak of memory."""
    READERS[name](path.with_name("short.mcap"), SHORT)
    begun = time.perf_counter()
    total = READERS[name](path, count)
    seconds = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"seconds": seconds, "total": total, "peak": peak}))


def measure(name: str, path: Path, count: int, repeats: int) -> tuple[float, float, int]:
    """Return median seconds, the sum of the values, and the most memory."""
    runs = []
    for _ in range(repeats):
        command = [sys.executable, __file__, "--one", name, str(path), str(count)]
        runs.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    return statistics.median(run["seconds"] for run in runs), runs[0]["total"], max(run["peak"] for run in runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--peer-count", type=int, default=100_000)
    parser.add_argument("--compression", action="append", choices=["zstd", "lz4", "none"])
    parser.add_argument("--one", nargs=3, metavar=("READER", "LOG", "COUNT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        run_one(options.one[0], Path(options.one[1]), int(options.one[2]))
        return
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for compression in options.compression or ["zstd", "none"]:
            path = Path(folder, "log.mcap")
            make_log(path, options.count, compression)
            make_log(path.with_name("short.mcap"), SHORT, compression)
            peer_count = min(options.count, options.peer_count)
            sums, base = {round(ours(path, peer_count), 3)}, 0.0
            for name in reversed(READERS):
                peer = not name.startswith("riot_bus")
                count = peer_count if peer else options.count
                seconds, total, peak = measure(name, path, count, options.repeats)
                if peer:
                    sums.add(round(total, 3))
                rate = count / seconds
                base = max(base, rate) if peer else base
                rows.append(
                    {
                        "compression": compression,
                        "reader": name,
                        "messages_per_second": round(rate),
                        "times_best_peer": round(rate / base, 2),
                        "peak_memory_mib": round(peak / (1 << 20)),
                        "file_mib": round(path.stat().st_size / (1 << 20)),
                    }
                )
            assert len(sums) == 1, f"readers disagree: {sums}"
    if options.json:
        print(json.dumps({"cores": os.cpu_count(), "messages": options.count, "rows": rows}, indent=2))
        return
    print(f"{options.count:,} messages; columns with memory = {MEMORY >> 20} MiB")
    print(f"{'file':14}{'reader':26}{'msg/s':>12}{'x best peer':>13}{'peak memory':>13}")
    for row in rows:
        file = f"{row['compression']} {row['file_mib']} MiB"
        print(
            f"{file:14}{row['reader']:26}{row['messages_per_second']:>12,}{row['times_best_peer']:>13}"
            f"{row['peak_memory_mib']:>9} MiB"
        )


if __name__ == "__main__":
    main()
