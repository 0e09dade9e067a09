"""A corpus of broken logs, the same in every run: whole files, each damaged in one way, and files made to do harm.

`python -m tests.log_mutants FOLDER` writes them out, to try other programs on them.
"""

from __future__ import annotations

import io
import json
import random
import struct
import sys
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import lz4.frame
import msgpack
import zstandard
from mcap.writer import CompressionType, Writer

from riot_bus.log import layout
from riot_bus.log.engine.blocks import EXTRAS, EXTRAS_TYPE
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.vocabulary.message import Message
from tests.manual_clock import ManualClock

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX = 8, 9, 10, 11, 12, 13
SUMMARY_OFFSET, DATA_END = 14, 15
START = 10**18
COUNT = 60
TWIST = "geometry_msgs/msg/Vector3"
TWIST_TEXT = b"float64 x\nfloat64 y\nfloat64 z\n"
STRING = "std_msgs/msg/String"
BOMB = 1 << 28


@dataclass(frozen=True)
class Mutant:
    """A broken log.

    Attributes:
        name: What is wrong with it.
        data: The file.
        readable: At least so many messages can be read.
        lossy: Whether something is missing that has to be counted; None if that cannot be told.
    """

    name: str
    data: bytes
    readable: int = 0
    lossy: bool | None = None


def record(opcode: int, body: bytes, *, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def text(value: str | bytes, *, length: int | None = None) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(data) if length is None else length) + data


def table(mapping: dict[str, str], *, length: int | None = None) -> bytes:
    data = b"".join(text(key) + text(value) for key, value in mapping.items())
    return struct.pack("<I", len(data) if length is None else length) + data


def header(profile: str | bytes = "ros2", library: str = "mutants") -> bytes:
    return record(HEADER, text(profile) + text(library))


def schema(number: int, name: str, data: bytes, encoding: str = "ros2msg") -> bytes:
    return record(SCHEMA, struct.pack("<H", number) + text(name) + text(encoding) + text(data))


def channel(
    number: int, topic: str, of: int = 1, encoding: str = "cdr", metadata: dict[str, str] | None = None
) -> bytes:
    return record(CHANNEL, struct.pack("<HH", number, of) + text(topic) + text(encoding) + table(metadata or {}))


def message(number: int, of: int = 1, payload: bytes | None = None, *, time: int | None = None) -> bytes:
    time = START + number if time is None else time
    return record(
        MESSAGE, struct.pack("<HIQQ", of, number, time, time) + (vector(number) if payload is None else payload)
    )


def vector(number: int) -> bytes:
    return b"\0\1\0\0" + struct.pack("<ddd", number, -number, 0.5)


def chunk(
    data: bytes,
    *,
    compression: str = "zstd",
    packed: bytes | None = None,
    size: int | None = None,
    checksum: int | None = None,
    start: int = START,
    end: int = START + COUNT,
    packed_size: int | None = None,
) -> bytes:
    if packed is None:
        packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}.get(compression, bytes)(data)
    body = struct.pack("<QQQ", start, end, len(data) if size is None else size)
    body += struct.pack("<I", zlib.crc32(data) if checksum is None else checksum) + text(compression)
    body += struct.pack("<Q", len(packed) if packed_size is None else packed_size) + packed
    return record(CHUNK, body)


def attachment(name: str, data: bytes, *, checksum: int | None = None) -> bytes:
    body = struct.pack("<QQ", 0, 0) + text(name) + text(EXTRAS_TYPE) + struct.pack("<Q", len(data)) + data
    return record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body) if checksum is None else checksum))


def note(name: str, mapping: dict[str, str], *, length: int | None = None) -> bytes:
    return record(METADATA, text(name) + table(mapping, length=length))


def statistics(messages: int, channels: int = 1, chunks: int = 1, counts: dict[int, int] | None = None) -> bytes:
    packed = b"".join(struct.pack("<HQ", *each) for each in (counts or {1: messages}).items())
    body = struct.pack("<QHIIIIQQ", messages, 1, channels, 0, 0, chunks, START, START + COUNT)
    return record(STATISTICS, body + struct.pack("<I", len(packed)) + packed)


def ending(summary: bytes = b"", *, before: int = 0, start: int | None = None, checksum: int = 0) -> bytes:
    """Data end, summary, footer and magic; `before` is the size of all that stands before."""
    begin = before + 13 if summary else 0
    footer = struct.pack("<QQI", begin if start is None else start, 0, checksum)
    return record(DATA_END, bytes(4)) + summary + record(FOOTER, footer) + MAGIC


DEFINITIONS = schema(1, TWIST, TWIST_TEXT) + channel(1, "/twist")
MESSAGES = b"".join(map(message, range(COUNT)))


def whole(*parts: bytes, summary: bytes = b"", **options: Any) -> bytes:
    body = MAGIC + header() + b"".join(parts)
    return body + ending(summary, before=len(body), **options)


# The files that are damaged.


@cache
def ours(compression: str) -> bytes:
    """A log of riot_bus with everything in it: attachments, originals, provenance, notes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.mcap")
        settings = LogSettings(compression=compression, chunk_bytes=900)
        with LogWriter(path, settings, clock=ManualClock(START), metadata={"seed": "7"}) as writer:
            writer.note(layout.GRAPH, {"time": "0", "whole": "true", "gone": "{}", "new": "{}"})
            for number in range(COUNT):
                payload = json.dumps({"x": number, "name": f"n{number}", "list": [1, 2.5]}).encode()
                key, attached = f"rover/{'ab'[number % 2]}", struct.pack("<qqB16s", number, number, 16, bytes(16))
                each = Message(START + number, key, payload, encoding="application/json", attachment=attached)
                each = each.with_(sequence=number, publish_time=START + number - 5)
                if number % 7 == 0:
                    writer.write(each.with_payload(b"{}"), role="original")
                changes = [Change("set", "set", "x", 1, float("nan"))] if number % 7 == 0 else []
                writer.write(each, changes=changes)
        return path.read_bytes()


@cache
def foreign(kind: str) -> bytes:
    """A file of somebody else."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {
        "zstd": {"chunk_size": 400},
        "lz4": {"chunk_size": 400, "compression": CompressionType.LZ4},
        "plain": {"chunk_size": 400, "compression": CompressionType.NONE},
        "unchunked": {"use_chunking": False},
    }[kind]
    writer = Writer(buffer, **options)
    writer.start(profile="ros2", library="somebody")
    twist = writer.register_channel("/twist", "cdr", writer.register_schema(TWIST, "ros2msg", TWIST_TEXT))
    string = writer.register_channel("/string", "cdr", writer.register_schema(STRING, "ros2msg", b"string data\n"))
    for number in range(COUNT):
        if number % 2:
            data = b"\0\1\0\0" + struct.pack("<I", 5) + b"%04d\0" % number
            writer.add_message(string, START + number, data, START + number, number)
        else:
            writer.add_message(twist, START + number, vector(number), START + number, number)
    writer.finish()
    return buffer.getvalue()


def bases() -> dict[str, bytes]:
    found = {f"ours {compression}": ours(compression) for compression in ("zstd", "lz4", "none")}
    return found | {f"foreign {kind}": foreign(kind) for kind in ("zstd", "lz4", "plain", "unchunked")}


def records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, beginning and end of each record of a whole file."""
    position = len(MAGIC)
    while position < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, position)
        yield opcode, position, position + 9 + length
        position += 9 + length


# What is done to them.


def cut_off() -> Iterator[Mutant]:
    for base, data in bases().items():
        for number, (opcode, begin, end) in enumerate(records(data)):
            if number % 12 and opcode not in (DATA_END, FOOTER, STATISTICS, HEADER):
                continue
            for place in {begin, begin + 5, (begin + end) // 2, end - 1}:
                yield Mutant(
                    f"{base}, cut at {place} in record {number} ({opcode})", data[:place], lossy=place < len(data)
                )
        for missing in (1, len(MAGIC), len(MAGIC) + 10):
            # without the last magic alone nothing of the content is missing
            yield Mutant(f"{base}, last {missing} bytes missing", data[:-missing], COUNT)


def flipped() -> Iterator[Mutant]:
    for base, data in bases().items():
        rng = random.Random(base)
        places = {rng.randrange(len(data)) for _ in range(12)}
        for number, (_, begin, _) in enumerate(records(data)):
            if number % 11 == 0:
                places |= {begin, begin + 1, begin + 2, begin + 5, begin + 8}
        for place in sorted(places):
            raw = bytearray(data)
            raw[place] ^= 1 << rng.randrange(8)
            yield Mutant(f"{base}, bit at {place} flipped", bytes(raw))


def overwritten() -> Iterator[Mutant]:
    for base, data in bases().items():
        rng = random.Random(f"{base} overwritten")
        for length in (16, 200, 1000):
            begin = rng.randrange(len(MAGIC), len(data) - length)
            for what, filler in (("zeros", bytes(length)), ("noise", rng.randbytes(length))):
                yield Mutant(f"{base}, {length} {what} at {begin}", data[:begin] + filler + data[begin + length :])
        middle = len(data) // 2
        yield Mutant(f"{base}, 100 bytes missing in the middle", data[:middle] + data[middle + 100 :])
        yield Mutant(f"{base}, 100 bytes more in the middle", data[:middle] + bytes(100) + data[middle:])
        yield Mutant(f"{base}, twice", data + data, COUNT)
        yield Mutant(f"{base}, followed by zeros", data + bytes(4096), COUNT)


def no_logs() -> Iterator[Mutant]:
    rng = random.Random(1)
    for name, data in {
        "empty": b"",
        "one byte": b"\x89",
        "half of the magic": MAGIC[:4],
        "magic alone": MAGIC,
        "magic twice": MAGIC + MAGIC,
        "a database": b"SQLite format 3\0" + bytes(4000),
        "text": b"this is no log\n" * 100,
        "zeros": bytes(10_000),
        "noise": rng.randbytes(10_000),
        "magic and zeros": MAGIC + bytes(10_000),
        "magic and noise": MAGIC + rng.randbytes(10_000),
        "another version": b"\x89MCAP1\r\n" + ours("zstd")[8:],
        "chunks without end": MAGIC + struct.pack("<BQ", CHUNK, 1 << 62) * 500,
        "nested lengths": MAGIC + b"".join(struct.pack("<BQ", CHUNK, 9 * n) for n in range(500)),
    }.items():
        yield Mutant(name, data)


def odd_definitions() -> Iterator[Mutant]:
    chunked = chunk(DEFINITIONS + MESSAGES)
    yield Mutant("no header", MAGIC + chunked + ending(), COUNT)
    yield Mutant("two headers", whole(header("other"), chunked), COUNT)
    yield Mutant("unknown profile", MAGIC + header("gibberish") + chunked + ending(), COUNT)
    yield Mutant("profile that is no text", MAGIC + header(b"\xff\xfe\x00") + chunked + ending(), COUNT)
    yield Mutant("profile with control characters", MAGIC + header("\x1b[2J\x1b]0;hi\x07") + chunked + ending(), COUNT)
    long = record(HEADER, text("ros2", length=1 << 31) + text("x"))
    yield Mutant("profile of 2 GiB", MAGIC + long + chunked + ending(), COUNT)
    yield Mutant("library of 1 MiB", MAGIC + header("ros2", "x" * (1 << 20)) + chunked + ending(), COUNT)
    twice = channel(1, "/other")
    yield Mutant("channel defined twice", whole(chunk(DEFINITIONS + twice + MESSAGES)), COUNT, lossy=True)
    yield Mutant("channel defined otherwise later", whole(chunked, chunk(twice + MESSAGES)), 2 * COUNT, lossy=True)
    yield Mutant("channel defined alike twice", whole(chunk(DEFINITIONS + DEFINITIONS + MESSAGES)), COUNT, lossy=False)
    other = schema(1, STRING, b"string data\n")
    yield Mutant("schema defined twice", whole(chunk(DEFINITIONS + other + MESSAGES)), COUNT)
    yield Mutant("channel of an unknown schema", whole(chunk(channel(1, "/twist", of=9) + MESSAGES)), COUNT)
    yield Mutant("no schema", whole(chunk(channel(1, "/twist", of=0) + MESSAGES)), COUNT)
    yield Mutant("no channel", whole(chunk(MESSAGES)), lossy=True)
    yield Mutant("channel after its messages", whole(chunk(MESSAGES + DEFINITIONS)), COUNT)
    yield Mutant(
        "channel 0 and 65535", whole(chunk(channel(0, "/a", 0) + channel(65535, "/b", 0) + message(1, 65535))), 1
    )
    yield Mutant("empty topic", whole(chunk(schema(1, TWIST, TWIST_TEXT) + channel(1, "") + MESSAGES)), COUNT)
    yield Mutant("topic with wildcards", whole(chunk(channel(1, "a/**/$*/?#", 0, "json") + MESSAGES)), COUNT)
    yield Mutant("topic with control characters", whole(chunk(channel(1, "/a\x1b[31m\n\0", 0) + MESSAGES)), COUNT)
    bad = record(CHANNEL, struct.pack("<HH", 1, 1) + text(b"\xff\xff") + text("cdr") + table({}))
    yield Mutant("topic that is no text", whole(chunk(schema(1, TWIST, TWIST_TEXT) + bad + MESSAGES)), lossy=True)
    cut = record(CHANNEL, struct.pack("<HH", 1, 1) + text("/twist", length=1 << 31))
    yield Mutant("topic of 2 GiB", whole(chunk(schema(1, TWIST, TWIST_TEXT) + cut + MESSAGES)), lossy=True)
    full = record(CHANNEL, struct.pack("<HH", 1, 1) + text("/twist") + text("cdr") + table({}, length=1 << 31))
    yield Mutant("channel metadata of 2 GiB", whole(chunk(schema(1, TWIST, TWIST_TEXT) + full + MESSAGES)), lossy=True)
    many = b"".join(channel(n, f"/t{n}", 0) for n in range(3000))
    yield Mutant("3000 channels", whole(chunk(many + MESSAGES)), COUNT)
    for name, value in {
        "qos of nested lists": "[" * 50_000,
        "qos of another kind": '{"a": 1}',
        "qos of wrong numbers": "[99999999999999999999, 7, []]",
    }.items():
        metadata = {layout.KEY: "a/b", layout.TOPIC: "/x", layout.QOS: value, layout.ROLE: "neither"}
        yield Mutant(name, whole(chunk(channel(1, "/x", 0, "json", metadata) + MESSAGES)), COUNT)
    odd_key = {layout.KEY: "//a//**//", layout.ROLE: "original"}
    yield Mutant("original of an odd key", whole(chunk(channel(1, "", 0, "json", odd_key) + MESSAGES)))
    for encoding in ("json", "msgpack", "protobuf", "ros1", "", "\0", "c" * 5000):
        yield Mutant(f"encoding {encoding[:8]!r}", whole(chunk(channel(1, "/x", 0, encoding) + MESSAGES)), COUNT)


def nested_types() -> bytes:
    """A schema whose listing would never end."""
    parts = ["\n".join(f"L1 a{n}" for n in range(8))]
    for level in range(1, 30):
        inner = f"L{level + 1}" if level < 29 else "float64"
        parts.append(f"MSG: p/L{level}\n" + "\n".join(f"{inner} a{n}" for n in range(8)))
    return f"\n{'=' * 80}\n".join(parts).encode()


def odd_schemas() -> Iterator[Mutant]:
    line = "=" * 80
    rng = random.Random(4)
    names: dict[str, bytes] = {
        "nothing": b"",
        "blanks": b" \n\n\t\n",
        "noise": rng.randbytes(3000),
        "zeros": bytes(3000),
        "type that contains itself": f"T me\n{line}\nMSG: p/T\nT me\n".encode(),
        "types that contain each other": f"A a\n{line}\nMSG: p/A\nB b\n{line}\nMSG: p/B\nA a\n".encode(),
        "unknown part": b"Nowhere x\nfloat64 y\n",
        "unknown package": b"nowhere/Thing x\n",
        "array of 4 billion": b"float64[4294967295] x\nfloat64 y\n",
        "array of 10^30": b"float64[1000000000000000000000000000000] x\n",
        "array of -1": b"float64[-1] x\n",
        "array of nothing": b"float64[0] x\nfloat64 y\n",
        "arrays of arrays": b"float64[2][3] x\n",
        "wide text": b"wstring w\nwstring<=5 v\nfloat64 x\n",
        "bounded": b"string<=3 s\nfloat64[<=3] x\n",
        "field twice": b"float64 x\nfloat64 x\n",
        "field of an odd name": b"float64 class\nfloat64 __init__\nfloat64 a-b\n",
        "brackets": b"float64[[[[[[[[[[[[[[[[ x\n",
        "no line ends": b"float64 x float64 y float64 z",
        "long line": b"float64 " + b"x" * 100_000,
        "many fields": "\n".join(f"float64 x{n}" for n in range(5000)).encode(),
        "many constants": "\n".join(f"int32 X{n}={n}" for n in range(2000)).encode(),
        "constant of wrong type": b'int32 X="a"\nbool B=7\nfloat64 x\n',
        "constant without end": b'string X="aaaaaaaaaaaaaaaaaaaaaa\n',
        "default values": b"float64 x 1.5\nint32[] y [1, 2, 3\n",
        "no separators": b"Other o\nMSG: p/Other\nfloat64 x\n",
        "many separators": (f"{line}\n" * 500).encode(),
        "deep nesting": nested_types(),
        "text that is no UTF-8": b"float64 \xff\xfe\n",
        "NUL in it": b"float64 x\0\nfloat64 y\n",
        "carriage returns": b"float64 x\r\rfloat64 y\r\n",
    }
    for name, data in names.items():
        content = chunk(schema(1, "p/msg/T", data) + channel(1, "/twist") + MESSAGES)
        yield Mutant(f"schema: {name}", whole(content), COUNT)
    for name in ("", "T", "p/q/r/s/t", "p//T", "../../etc/passwd", "p/msg/" + "x" * 10_000, "\0/msg/\0", "p/srv/T"):
        content = chunk(schema(1, name, TWIST_TEXT) + channel(1, "/twist") + MESSAGES)
        yield Mutant(f"schema named {name[:20]!r}", whole(content), COUNT)
    for name, data in {
        "idl of nothing": b"",
        "idl of noise": rng.randbytes(1000),
        "idl without end": f"{line}\nIDL: p/msg/T\nmodule p {{ module msg {{ struct T {{ double x;".encode(),
        "idl that contains itself": f"{line}\nIDL: p/msg/T\nmodule p {{module msg {{struct T {{T x;}};}};}};".encode(),
        "idl of brackets": b"{" * 3000,
    }.items():
        content = chunk(schema(1, "p/msg/T", data, "ros2idl") + channel(1, "/twist") + MESSAGES)
        yield Mutant(f"schema: {name}", whole(content), COUNT)
    other = chunk(schema(1, "T", b"\xff" * 50, "protobuf") + channel(1, "/twist", encoding="protobuf") + MESSAGES)
    yield Mutant("schema: another encoding", whole(other), COUNT)


def lying_chunks() -> Iterator[Mutant]:
    data = DEFINITIONS + MESSAGES
    sound = chunk(DEFINITIONS + message(0))
    for compression in ("zstd", "lz4", ""):
        name = compression or "none"
        for size in (0, 1, len(data) - 1, len(data) + 1, 1 << 31, 1 << 62, (1 << 64) - 1):
            yield Mutant(
                f"{name} chunk that claims {size} bytes",
                whole(sound, chunk(data, compression=compression, size=size)),
                1,
                True,
            )
        yield Mutant(
            f"{name} chunk of wrong checksum", whole(sound, chunk(data, compression=compression, checksum=1)), 1, True
        )
        yield Mutant(
            f"{name} chunk without checksum", whole(chunk(data, compression=compression, checksum=0)), COUNT, False
        )
        for packed_size in (0, 5, 1 << 40, (1 << 64) - 1):
            mutant = chunk(data, compression=compression, packed_size=packed_size)
            yield Mutant(f"{name} chunk whose data claims {packed_size} bytes", whole(sound, mutant), 1)
        yield Mutant(
            f"{name} chunk of noise",
            whole(sound, chunk(data, compression=compression, packed=random.Random(2).randbytes(500))),
            1,
            True,
        )
        yield Mutant(f"{name} chunk of nothing", whole(sound, chunk(b"", compression=compression)), 1)
        late = chunk(data, compression=compression, start=(1 << 64) - 1, end=0)
        yield Mutant(f"{name} chunk of impossible times", whole(late), COUNT)
        yield Mutant(
            f"{name} chunk of wrong times",
            whole(sound, chunk(data, compression=compression, start=0, end=1)),
            COUNT + 1,
        )
    yield Mutant("zstd chunk that is lz4", whole(sound, chunk(data, packed=lz4.frame.compress(data))), 1, True)
    yield Mutant(
        "lz4 chunk that is zstd", whole(sound, chunk(data, compression="lz4", packed=zstandard.compress(data))), 1, True
    )
    yield Mutant("unknown compression", whole(sound, chunk(data, compression="brotli")), 1, True)
    yield Mutant(
        "compression that is no text",
        whole(sound, record(CHUNK, struct.pack("<QQQI", 0, 1, 2, 3) + text(b"\xff\xff") + bytes(8))),
        1,
    )
    yield Mutant(
        "compression of 4 GiB",
        whole(sound, record(CHUNK, struct.pack("<QQQI", 0, 1, 2, 3) + text(b"zstd", length=(1 << 32) - 1) + bytes(8))),
        1,
    )
    yield Mutant("chunk of a few bytes", whole(sound, record(CHUNK, b"abc")), 1)
    yield Mutant("chunk in a chunk", whole(sound, chunk(chunk(data))), 1)
    yield Mutant("footer in a chunk", whole(chunk(DEFINITIONS + record(FOOTER, bytes(20)) + MESSAGES)), COUNT)
    frames = zstandard.compress(data[:100]) + zstandard.compress(data[100:])
    yield Mutant("chunk of two frames", whole(sound, chunk(data, packed=frames)), 1)
    stream = zstandard.ZstdCompressor(write_content_size=False).compress(data)
    yield Mutant("chunk whose frame has no size", whole(chunk(data, packed=stream)), COUNT, False)
    yield Mutant("chunk with something behind it", whole(chunk(data, packed=zstandard.compress(data) + b"more")), COUNT)
    for name, inside in {
        "message that is too short": record(MESSAGE, b"x" * 21),
        "message beyond the end": record(MESSAGE, b"x" * 30, length=1 << 20),
        "message of 2^64 bytes": record(MESSAGE, b"x" * 30, length=(1 << 64) - 1),
        "half a record": b"\x05\x01",
        "unknown records": record(0x99, b"abc") + record(0, b""),
        "schema beyond the end": record(SCHEMA, b"x", length=1 << 40),
    }.items():
        yield Mutant(f"chunk with a {name}", whole(sound, chunk(DEFINITIONS + MESSAGES + inside)), 1)
    overlapping = [chunk(DEFINITIONS + message(n), start=START, end=START + COUNT) for n in reversed(range(COUNT))]
    yield Mutant("chunks that overlap", whole(*overlapping), COUNT, False)
    backwards = [chunk(DEFINITIONS + message(n), start=START + n, end=START + n) for n in reversed(range(COUNT))]
    yield Mutant("chunks in reverse order", whole(*backwards), COUNT, False)


def bombs() -> Iterator[Mutant]:
    zeros = bytes(1 << 20)
    compressor = zstandard.ZstdCompressor(level=1, write_content_size=True).compressobj(size=BOMB)
    packed = b"".join(compressor.compress(zeros) for _ in range(BOMB >> 20)) + compressor.flush()
    sound = chunk(DEFINITIONS + MESSAGES)
    yield Mutant(
        "zstd bomb that claims its size", whole(sound, chunk(b"", packed=packed, size=BOMB, checksum=0)), COUNT
    )
    yield Mutant(
        "zstd bomb that claims 100 bytes", whole(sound, chunk(b"", packed=packed, size=100, checksum=0)), COUNT, True
    )
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    packed = b"".join(compressor.compress(zeros) for _ in range(BOMB >> 20)) + compressor.flush()
    yield Mutant("zstd bomb without size", whole(sound, chunk(b"", packed=packed, size=100, checksum=0)), COUNT, True)
    with io.BytesIO() as buffer:
        with lz4.frame.open(buffer, "wb") as file:
            for _ in range(64):
                file.write(zeros)
        packed = buffer.getvalue()
    yield Mutant(
        "lz4 bomb that claims 100 bytes",
        whole(sound, chunk(b"", compression="lz4", packed=packed, size=100, checksum=0)),
        COUNT,
    )
    small = message(0, payload=b"") * 20_000
    yield Mutant("many tiny messages", whole(*[chunk(DEFINITIONS + small, start=0) for _ in range(5)]), 100_000)
    huge = schema(1, TWIST, b"#" * (1 << 26)) + channel(1, "/twist")
    yield Mutant("schema of 64 MiB", whole(chunk(huge + MESSAGES)), COUNT)
    room = [chunk(schema(n, f"p/msg/T{n}", bytes(1 << 22)) + channel(n, f"/t{n}", n)) for n in range(1, 20)]
    yield Mutant("schemas of 4 MiB each", whole(*room, sound))
    yield Mutant("many notes", whole(sound, note("x", {}) * 20_000), COUNT)
    yield Mutant("many empty records", whole(sound, record(0x80, b"") * 50_000), COUNT)
    gaps = b"".join(record(MESSAGE, b"x", length=1 << 50) + message(n) for n in range(2000))
    yield Mutant("many gaps", whole(DEFINITIONS, gaps))
    yield Mutant("chunks of nothing but a head", whole(*[chunk(b"", start=n, end=n) for n in range(5_000)]))


def odd_extras() -> Iterator[Mutant]:
    content = chunk(channel(1, "a/b", 0, "json", {layout.KEY: "a/b"}) + MESSAGES)

    def extras(pairs: Any, **options: Any) -> bytes:
        return attachment(EXTRAS, zstandard.compress(msgpack.packb(pairs)), **options)

    for name, data in {
        "extras of noise": attachment(EXTRAS, b"noise" * 20),
        "extras of wrong checksum": extras([[0, {"a": b"x"}]], checksum=1),
        "extras without data": attachment(EXTRAS, b""),
        "extras that are a number": extras(7),
        "extras that are a map": extras({"a": 1}),
        "extras of odd places": extras([[-1, {}], [1 << 62, {}], ["x", {}], [None, {}]]),
        "extras of infinite place": extras([[float("inf"), {}]]),
        "extras of odd values": extras([[0, {"a": 1, "e": b"x", "s": [], "q": {}, "d": 3, "p": "x" * 100, "n": "y"}]]),
        "extras of odd keys": extras([[0, {1: 2, b"x": 3, "unknown": 4}]]),
        "extras for each message twice": extras([[n % COUNT, {"a": bytes(5)}] for n in range(2 * COUNT)]),
        "extras of nested lists": attachment(EXTRAS, zstandard.compress(b"\x91" * 5000)),
        "extras that claim long lists": attachment(EXTRAS, zstandard.compress(b"\xdd\x00\x40\x00\x00" * 1000)),
        "extras of many empty lists": attachment(
            EXTRAS, zstandard.compress(b"\xdd\x01\x00\x00\x00" + b"\x90" * (1 << 24))
        ),
        "extras of 256 MiB of zeros": attachment(EXTRAS, zstandard.compress(bytes(BOMB))),
        "extras without a size": attachment(
            EXTRAS, zstandard.ZstdCompressor(write_content_size=False).compress(b"\x90")
        ),
        "extras that claim 2^60 bytes": attachment(EXTRAS, b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 1 << 60)),
        "extras cut off": record(ATTACHMENT, struct.pack("<QQ", 0, 0) + text(EXTRAS)),
        "extras of a name of 4 GiB": record(ATTACHMENT, struct.pack("<QQ", 0, 0) + text(EXTRAS, length=(1 << 32) - 1)),
    }.items():
        yield Mutant(name, whole(data, content), COUNT)
    yield Mutant("extras of a delete", whole(extras([[0, {"d": True, "n": -5, "p": "-7"}]]), content), COUNT, False)
    yield Mutant("extras without a chunk", whole(content, extras([[0, {}]])), COUNT, False)
    for name, value in {
        "nothing": "",
        "no JSON": "{",
        "a number": "7",
        "nested lists": "[" * 100_000,
        "wrong rows": '[1, "a", null]',
        "rows that lack things": '[{"sequence": 1}]',
        "infinite numbers": '[{"sequence": Infinity, "key": "a", "time": NaN, "role": 1, "changes": []}]',
        "odd changes": '[{"sequence":1,"key":1,"time":2,"role":3,"changes":[{"interceptor":1,"action":2,"field":{},'
        '"before":{"bytes":"?"},"after":{}}]}]',
        "a number of 5000 digits": f'[{{"sequence": {"9" * 5000}, "key": "a", "time": 1, "role": "x", "changes": []}}]',
    }.items():
        yield Mutant(f"provenance of {name}", whole(note(layout.PROVENANCE, {"changes": value}), content), COUNT)
    for name, data in {
        "metadata of 4 GiB": note(layout.RUN, {"a": "b"}, length=(1 << 32) - 1),
        "metadata that is no text": record(
            METADATA, text(layout.RUN) + table({}, length=9) + text(b"\xff") + text(b"")
        ),
        "metadata of nothing": record(METADATA, b""),
        "metadata without a name": note("", {"a": "b"}),
        "run twice": note(layout.RUN, {"seed": "1"}) + note(layout.RUN, {"seed": "2"}),
        "run with control characters": note(layout.RUN, {"\x1b[2J": "\x07\n"}),
        "odd graph": note(layout.GRAPH, {"time": "x", "new": "["}),
        "odd account": note(
            "riot_bus.lost", {"version": "1", "recorded": "[]", "lost": '{"disk": {"a": "b"}}', "left_out": "{}"}
        ),
        "account of nested lists": note(
            "riot_bus.lost", {"version": "1", "recorded": "[" * 100_000, "lost": "{}", "left_out": "{}"}
        ),
    }.items():
        yield Mutant(name, whole(data, content), COUNT)


def odd_summaries() -> Iterator[Mutant]:
    content = chunk(DEFINITIONS + MESSAGES)
    for start in (1, 8, 100, 10**6, 1 << 62, (1 << 64) - 1):
        yield Mutant(f"summary at {start}", whole(content, summary=DEFINITIONS + statistics(COUNT), start=start), COUNT)
    sound = DEFINITIONS + statistics(COUNT)
    yield Mutant("summary of wrong checksum", whole(content, summary=sound, checksum=7), COUNT)
    for name, summary in {
        "too many messages": DEFINITIONS + statistics(COUNT + 5),
        "too few messages": DEFINITIONS + statistics(1),
        "2^64 - 1 messages": DEFINITIONS + statistics((1 << 64) - 1),
        "no channel": statistics(COUNT),
        "channels of a chunk that is not there": DEFINITIONS + statistics(COUNT, chunks=2),
        "2^32 - 1 chunks": DEFINITIONS + statistics(COUNT, chunks=(1 << 32) - 1),
        "counts of unknown channels": DEFINITIONS + statistics(COUNT, counts={77: COUNT}),
        "no statistics": DEFINITIONS,
        "statistics cut off": DEFINITIONS + record(STATISTICS, b"abc"),
        "another channel": schema(1, TWIST, TWIST_TEXT) + channel(1, "/elsewhere") + statistics(COUNT),
        "chunk index beyond the file": sound
        + record(CHUNK_INDEX, struct.pack("<QQQQI", 0, 1, 1 << 50, 9, 0) + bytes(28)),
        "chunk index cut off": sound + record(CHUNK_INDEX, b"abc"),
        "metadata index beyond the file": sound
        + record(METADATA_INDEX, struct.pack("<QQ", 1 << 50, 1 << 40) + text(layout.RUN)),
        "attachment index beyond the file": sound
        + record(ATTACHMENT_INDEX, struct.pack("<QQQQQ", 1 << 50, 9, 0, 0, 9) + text("a") + text("b")),
        "summary offsets beyond the file": sound + record(SUMMARY_OFFSET, struct.pack("<BQQ", 4, 1 << 60, 1 << 60)),
        "noise": random.Random(5).randbytes(400),
        "chunks": content,
        "messages": DEFINITIONS + MESSAGES,
    }.items():
        lossy = True if "not there" in name else None
        yield Mutant(f"summary: {name}", whole(content, summary=summary), COUNT, lossy)
    yield Mutant("no footer", MAGIC + header() + content + record(DATA_END, bytes(4)), COUNT, True)
    yield Mutant("footer of another length", MAGIC + header() + content + record(FOOTER, bytes(5)) + MAGIC, COUNT)
    yield Mutant("two footers", MAGIC + header() + content + record(FOOTER, bytes(20)) + content + ending(), COUNT)
    yield Mutant("data after the data end", MAGIC + header() + record(DATA_END, bytes(4)) + content + ending(), COUNT)
    index = struct.pack("<HI", 1, 16 * COUNT) + b"".join(struct.pack("<QQ", START, 1 << 60) for _ in range(COUNT))
    yield Mutant("message index beyond the chunk", whole(content, record(MESSAGE_INDEX, index)), COUNT, False)
    yield Mutant("message index cut off", whole(content, record(MESSAGE_INDEX, index[:30])), COUNT, False)


def odd_messages() -> Iterator[Mutant]:
    for time in (0, (1 << 63) - 1, 1 << 63, (1 << 64) - 1):
        yield Mutant(
            f"messages at {time}", whole(chunk(DEFINITIONS + message(1, time=time) + message(2), start=0, end=time)), 2
        )
    for name, payload in {
        "nothing": b"",
        "half a head": b"\0\1",
        "a head": b"\0\1\0\0",
        "another encapsulation": b"\0\x0a\0\0" + bytes(24),
        "too little": b"\0\1\0\0" + bytes(20),
        "ones": b"\0\1\0\0" + b"\xff" * 24,
        "a megabyte": b"\0\1\0\0" + bytes(1 << 20),
    }.items():
        yield Mutant(f"messages of {name}", whole(chunk(DEFINITIONS + message(1, payload=payload) + message(2))), 2)
    sequences = b"string[] names\nfloat64[] numbers\nfloat64 x\n"
    definitions = schema(1, "p/msg/S", sequences) + channel(1, "/twist")
    for count in (1, 1 << 16, 1 << 31, (1 << 32) - 1):
        payload = b"\0\1\0\0" + struct.pack("<I", count) + struct.pack("<I", 0) * 50
        yield Mutant(f"sequences of {count} elements", whole(chunk(definitions + message(1, payload=payload) * 20)), 20)
    for encoding, payload in {
        "json": b"[" * 100_000,
        "json ": b'{"a": ' * 5000,
        "json  ": b'{"x": 1e999999, "y": ' + b"9" * 5000 + b"}",
        "json   ": b'{"x": "\\ud800"}',
        "msgpack": b"\x91" * 100_000,
        "msgpack ": b"\xdf\xff\xff\xff\xff",
        "msgpack  ": b"\xdd\xff\xff\xff\xff" * 100,
        "msgpack   ": b"\x81\xa1x\xc7\x0c\xff" + b"\xff" * 12,
    }.items():
        content = chunk(
            channel(1, "/twist", 0, encoding.strip()) + message(1, payload=payload) + message(2, payload=b"{}")
        )
        yield Mutant(f"{encoding.strip()} that goes wrong, {len(encoding) - len(encoding.strip())}", whole(content), 2)
    infinite = chunk(
        DEFINITIONS
        + b"".join(
            message(n, payload=b"\0\1\0\0" + struct.pack("<ddd", *[float(x)] * 3))
            for n, x in enumerate(["inf", "-inf", "nan"])
        )
    )
    yield Mutant("infinite numbers", whole(infinite), 3, False)


_GENERATORS = (
    no_logs,
    cut_off,
    flipped,
    overwritten,
    odd_definitions,
    odd_schemas,
    lying_chunks,
    bombs,
    odd_extras,
    odd_summaries,
    odd_messages,
)


def mutants() -> Iterator[Mutant]:
    """Yield the whole corpus, always the same."""
    for generate in _GENERATORS:
        yield from generate()


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, mutant in enumerate(mutants()):
        (folder / f"{number:04}.mcap").write_bytes(mutant.data)
        print(f"{number:04} {mutant.name}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
