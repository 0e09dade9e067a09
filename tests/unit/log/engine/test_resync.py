"""Behind a damaged length, reading goes on where the next chunk or message begins."""

import os
import struct

import pytest

from riot_bus.log.engine.resync import next_record
from riot_bus.log.reader import LogReader
from tests.log_mutants import (
    COUNT,
    DEFINITIONS,
    FOOTER,
    MAGIC,
    MESSAGES,
    chunk,
    ending,
    foreign,
    header,
    message,
    ours,
    record,
    records,
    whole,
)


def read(path, data):
    path.write_bytes(data)
    with LogReader(path) as reader:
        return [found.time for found in reader.messages()], reader.loss


@pytest.mark.parametrize("base", ["ours zstd", "ours none", "zstd", "lz4", "plain"])
def test_every_other_chunk_is_read(tmp_path, base):
    kind, _, name = base.rpartition(" ")
    data = ours(name) if kind else foreign(name)
    chunks = [begin for opcode, begin, _ in records(data) if opcode == 6]
    for place in range(0, len(chunks) - 1, 2):
        raw = bytearray(data)
        struct.pack_into("<Q", raw, chunks[place] + 1, 1 << 50)
        times, loss = read(tmp_path / "a.mcap", bytes(raw))
        assert loss.bytes >= chunks[place + 1] - chunks[place]
        assert not loss.unfinished
        assert len(times) == COUNT  # the chunk itself says where its data ends


def test_messages_outside_of_chunks(tmp_path):
    data = foreign("unchunked")
    messages = [begin for opcode, begin, _ in records(data) if opcode == 5]
    raw = bytearray(data)
    struct.pack_into("<Q", raw, messages[20] + 1, 1 << 50)
    times, loss = read(tmp_path / "a.mcap", bytes(raw))
    assert len(times) == COUNT - 1
    assert loss.bytes == messages[21] - messages[20]


def test_zeros_in_the_middle(tmp_path):
    first, second = chunk(DEFINITIONS + message(1)), chunk(message(2))
    for length in (1, 8, 9, 100, 70_000, (1 << 22) + 5):
        times, loss = read(tmp_path / "a.mcap", whole(first, bytes(length), second))
        assert len(times) == 2
        assert loss.bytes == length


def test_where_nothing_follows_the_summary_is_found(tmp_path):
    body = MAGIC + header() + chunk(DEFINITIONS + MESSAGES) + record(7, b"x", length=1 << 50)
    data = body + ending(DEFINITIONS, before=len(body))
    times, loss = read(tmp_path / "a.mcap", data)
    assert len(times) == COUNT
    assert not loss.unfinished
    assert loss.bytes == 10 + 13


def test_no_chunk_is_seen_where_none_is(tmp_path):
    path = tmp_path / "a"
    sound = chunk(DEFINITIONS + MESSAGES)
    for wrong in (
        bytes(200),
        b"\x06" * 200,
        b"\x05" * 200,
        sound[:-1],
        b"\x06" + struct.pack("<Q", len(sound)) + sound[9:],
        chunk(MESSAGES, start=5, end=4),
        chunk(MESSAGES, size=1 << 40),
        chunk(MESSAGES, compression="other"),
        message(1) + message(2),
    ):
        path.write_bytes(wrong)
        file = os.open(path, os.O_RDONLY)
        try:
            assert next_record(file, 0, len(wrong), {}) is None
        finally:
            os.close(file)


def test_two_footers_and_the_rest_is_not_read(tmp_path):
    data = MAGIC + header() + chunk(DEFINITIONS + MESSAGES) + record(FOOTER, bytes(20)) + MAGIC
    times, loss = read(tmp_path / "a.mcap", data)
    assert len(times) == COUNT
    assert not loss
