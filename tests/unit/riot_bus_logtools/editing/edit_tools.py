"""Logs to edit, and what is in them as somebody else's library tells it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions
from riot_bus_logtools.editing.result import EditCounts, EditResult

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND
NUMBER = "float64 x\nuint8 small\nstring name\nfloat32[] values\n"


class Raw(NamedTuple):
    """A message with all that its file says of it."""

    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]
    schema: tuple[str, str, bytes] | None
    sequence: int
    time: int
    published: int
    data: bytes


def raw(path: Path, *, complete: bool = True) -> list[Raw]:
    """The messages in the order of the file, as the library `mcap` reads them, with all checksums.

    Args:
        path: The file.
        complete: Whether it has statistics, and indexes that lead to all messages.
    """
    found = []
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Channel):
                assert channels.setdefault(record.id, record) == record
            elif isinstance(record, Schema):
                assert schemas.setdefault(record.id, record) == record
            elif type(record).__name__ == "Message":
                message: Any = record
                channel = channels[message.channel_id]
                schema = schemas[channel.schema_id] if channel.schema_id else None
                found.append(
                    Raw(
                        channel.topic,
                        channel.message_encoding,
                        tuple(sorted(channel.metadata.items())),
                        (schema.name, schema.encoding, schema.data) if schema else None,
                        message.sequence,
                        message.log_time,
                        message.publish_time,
                        message.data,
                    )
                )
    if not complete:
        return found
    with path.open("rb") as file:
        indexed = make_reader(file, validate_crcs=True)
        count = sum(1 for _ in indexed.iter_messages())
        summary = indexed.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert (count, summary.statistics.message_count) == (len(found), len(found))
    return found


def metadata(path: Path) -> list[tuple[str, dict[str, str]]]:
    """The metadata records."""
    with path.open("rb") as file:
        return [(each.name, each.metadata) for each in make_reader(file).iter_metadata()]


def chunk_sizes(path: Path) -> list[tuple[str, int]]:
    """Compression and compressed size of each chunk."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [(each.compression, each.compressed_size) for each in summary.chunk_indexes]


def json_log(path: Path, count: int, topics: Sequence[str] = ("a", "b"), **settings: Any) -> Path:
    """A log of ours: `{"v": 0}`, `{"v": 1}` ... over the topics in turn, ten messages a second."""
    with LogWriter(path, LogSettings(**{"chunk_bytes": 400, **settings})) as writer:
        for number in range(count):
            writer.write(
                Message(
                    BEGIN + number * SECOND // 10,
                    topics[number % len(topics)],
                    b'{"v": %d}' % number,
                    encoding="application/json",
                    attachment=b"%d" % number if number % 3 == 0 else None,
                    sequence=number,
                )
            )
    return path


def cdr(x: float, small: int = 1, name: str = "abc", values: Sequence[float] = (1.0, 2.0)) -> bytes:
    """A message of the type test_msgs/msg/Number."""
    import struct

    text = name.encode() + b"\0"
    data = struct.pack("<d", x) + struct.pack("<B", small) + b"\0\0\0" + struct.pack("<I", len(text)) + text
    data += b"\0" * (-len(data) % 4) + struct.pack("<I", len(values)) + struct.pack(f"<{len(values)}f", *values)
    return b"\0\1\0\0" + data


def bag(path: Path, rows: Iterable[tuple[str, int, bytes]], **options: Any) -> Path:
    """A file of somebody else's: topic, time and data in this order; the publish time is 5 ns before."""
    known = {"chunk_size": 500, "compression": CompressionType.ZSTD, **options}
    with path.open("wb") as file:
        writer = Writer(file, **known)
        writer.start(profile="ros2", library="somebody")
        schema = writer.register_schema("test_msgs/msg/Number", "ros2msg", NUMBER.encode())
        channels: dict[str, int] = {}
        for number, (topic, time, data) in enumerate(rows):
            if topic not in channels:
                channels[topic] = writer.register_channel(
                    topic, "cdr", schema, {"offered_qos_profiles": "", "n": topic}
                )
            writer.add_message(channels[topic], time, data, max(0, time - 5), number)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def numbers(count: int, topics: Sequence[str] = ("/a", "/b")) -> list[tuple[str, int, bytes]]:
    """Rows for `bag`: x is 0.0, 1.0 ..., ten messages a second."""
    return [(topics[n % len(topics)], BEGIN + n * SECOND // 10, cdr(float(n))) for n in range(count)]


def run(inputs: Path | Sequence[Path], output: Path, interceptors: Sequence[object] = (), **options: Any) -> EditResult:
    """Edit; nothing is left behind, whatever happens."""
    files = [inputs] if isinstance(inputs, Path) else list(inputs)
    before = set(os.listdir(output.parent))
    try:
        return edit(EditOptions(inputs=files, output=output, **options), interceptors=interceptors)
    finally:
        left = set(os.listdir(output.parent)) - before
        assert not [name for name in left if name.startswith(".")]


def counts(result: EditResult) -> dict[str, tuple[int, int, int]]:
    """Kept, changed and dropped messages by topic."""
    return {each.topic: (each.kept, each.changed, each.dropped) for each in result.topics}


def topic(result: EditResult, name: str) -> EditCounts:
    """The counts of one topic."""
    return next(each for each in result.topics if each.topic == name)
