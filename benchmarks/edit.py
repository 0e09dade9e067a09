"""Messages per second of `riot edit` beside a plain copy by the library mcap: `python benchmarks/edit.py [--json]`."""

from __future__ import annotations

import argparse
import json
import struct
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common import rate
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions

TOPICS = 8
BEGIN = 1_700_000_000 * 10**9
DEFINITION = "float64 x\nfloat64 y\nuint8[] data\n"


def write(path: Path, count: int, size: int) -> None:
    """Write a bag with as many messages as ROS 2 would, a thousand a second."""
    filler = bytes(range(256)) * (size // 256 + 1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = writer.register_schema("bench_msgs/msg/Sample", "ros2msg", DEFINITION.encode())
        channels = [writer.register_channel(f"/robot/topic{n}", "cdr", schema) for n in range(TOPICS)]
        length = size - 24
        for n in range(count):
            head = struct.pack("<4sddI", b"\0\1\0\0", float(n), 0.5, length)
            stamp = BEGIN + n * 10**6
            writer.add_message(channels[n % TOPICS], stamp, head + filler[n % 256 : n % 256 + length], stamp, n)
        writer.finish()  # type: ignore[no-untyped-call]


def naive(source: Path, target: Path) -> None:
    """Copy a log message by message."""
    with source.open("rb") as file, target.open("wb") as out:
        writer = Writer(out, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in channels:
                if schema is not None and schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                number = schemas[schema.id] if schema is not None else 0
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()  # type: ignore[no-untyped-call]


def edits(seconds: float) -> Mapping[str, Mapping[str, Any]]:
    return {
        "copy": {},
        "remap and slice": {"remap": ["/robot/**:=/r/**"], "start": "0.0005", "end": str(seconds - 0.0005)},
        "set one field of one topic": {"changes": ["/robot/topic3:x = nan"]},
        "set one field of all": {"changes": ["**:x = nan"]},
        "add to one field of all": {"changes": ["**:x += 1"]},
        "drop by a field of all": {"drop": ["** where x < 0"]},
        "recompress": {"compression": "lz4"},
        "sort": {"sort": True, "compression": "lz4"},
        "merge with itself": {},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--count", type=int, default=200_000)
    parser.add_argument("--size", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    count = options.count
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "in.mcap"), Path(folder, "out.mcap")
        write(source, count, options.size)
        base = rate(lambda: naive(source, target), count=count, repeats=options.repeats)
        rows = [{"edit": "copy by the library mcap", "messages_per_second": round(base), "ratio": 1.0}]
        for name, wanted in edits(count / 1000).items():
            inputs = [source, source] if name.startswith("merge") else [source]
            wish = EditOptions(inputs=inputs, output=target, force=True, **wanted)

            def work(wish: EditOptions = wish) -> None:
                result = edit(wish)
                assert result.total().kept >= count - 2, result

            own = rate(work, count=count * len(inputs), repeats=options.repeats)
            rows.append({"edit": name, "messages_per_second": round(own), "ratio": round(own / base, 1)})
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    print(f"{count} messages of {options.size} bytes")
    for row in rows:
        print(f"{row['edit']:30}{row['messages_per_second']:>12,} msg/s{row['ratio']:>8} x")


if __name__ == "__main__":
    main()
