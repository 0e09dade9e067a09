from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.records import Channel, Metadata, Schema

from riot_bus.log.engine.blocks import CHUNK, HEAD, MAGIC, Block, Span, message_bytes, read_block
from riot_bus.log.engine.chunk import ChunkBuilder, Companions
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits
from riot_bus.log.engine.mcap_file import McapFile, record_bytes
from riot_bus.log.engine.scan import (
    Scan,
    define,
    load_block,
    parse,
    parse_footer,
    read_attachment,
    read_metadata,
    scan_file,
)
from riot_bus.log.layout import pack_extras
from riot_bus.vocabulary.errors import ConfigError

CHANNEL = Channel(id=1, topic="a", message_encoding="json", metadata={}, schema_id=0)


@pytest.fixture
def scan(tmp_path: Path) -> Callable[..., Scan]:
    """Scans a file of these bytes, which stays open as `scan.file`."""

    def scanned(data: bytes, limits: LogLimits = DEFAULT_LIMITS) -> Scan:
        path = tmp_path / "a.mcap"
        path.write_bytes(data)
        scanned.file = os.open(path, os.O_RDONLY)  # type: ignore[attr-defined]
        return scan_file(scanned.file, str(path), limits)  # type: ignore[attr-defined]

    return scanned


@pytest.fixture
def log(tmp_path: Path) -> bytes:
    """A log of two chunks of two messages each, extras before the second one, a note and an end."""
    path = tmp_path / "written.mcap"
    file = McapFile(path, profile="p", library="l", compression="none")
    for number in range(2):
        builder = ChunkBuilder()
        if not number:
            builder.define(record_bytes(CHANNEL))
        rows = [(1, n, 10 * number + n, 10 * number + n, b"%d" % n, None) for n in range(2)]
        builder.fill(iter(rows), 1 << 20)
        file.chunk(builder.end().chunk(), Companions(pack_extras([(1, {"a": b"x"})]) if number else b""))
    file.metadata("note", {"k": "v"})
    file.finish([], [CHANNEL])
    file.close()
    return path.read_bytes()


def test_a_whole_file(scan, log: bytes) -> None:
    found = scan(log)
    assert (found.header.profile, found.finished, found.unread, found.missing_chunks) == ("p", True, 0, 0)
    assert [(each.number, each.start, each.end, each.chunked, each.cut) for each in found.blocks] == [
        (0, 0, 1, True, False),
        (1, 10, 11, True, False),
    ]
    assert [name for name, _ in found.metadata] == ["note"]
    assert read_metadata(scan.file, found.metadata[0][1]) == {"k": "v"}
    assert read_metadata(scan.file, found.metadata[0][1], replace(DEFAULT_LIMITS, definitions=1)) is None
    first, second = found.blocks
    assert first.extras is None
    assert read_attachment(scan.file, second.extras)
    assert found.channels == {1: CHANNEL}
    assert found.statistics.message_count == 4


def test_the_messages_of_a_block(scan, log: bytes) -> None:
    found = scan(log)
    found.channels.clear()
    block = found.blocks[0]
    data = read_block(scan.file, block)
    entries = load_block(data, block, found, {1: {"a": b"x"}})
    assert [(each.time, each.order, each.sequence, each.payload, each.extras) for each in entries] == [
        (0, 0, 0, b"0", None),
        (1, 1, 1, b"1", {"a": b"x"}),
    ]
    assert found.channels == {1: CHANNEL}
    with pytest.raises(ValueError, match="beyond its end"):
        load_block(data[:-1], block, found, {})
    block.cut = True
    assert len(load_block(data[:-1], block, found, {})) == 1
    with pytest.raises(ValueError, match="messages"):
        load_block(data, block, Scan(1, replace(DEFAULT_LIMITS, messages=1)), {})


@pytest.mark.parametrize(("data", "words"), [(b"", "empty"), (b"nothing of the kind", "not an MCAP file")])
def test_what_is_no_log(scan, data: bytes, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        scan(data)


def test_a_file_that_was_not_closed(scan, log: bytes) -> None:
    end = log.index(record_bytes(Metadata(name="note", metadata={"k": "v"})))
    found = scan(log[:end])
    assert (found.finished, found.unread, len(found.blocks)) == (False, 0, 2)
    found = scan(log[: end - 60])  # in the index of the second chunk
    assert (found.finished, len(found.blocks)) == (False, 2)
    assert found.unread > 0


def test_a_chunk_that_is_cut_off_counts_as_far_as_it_goes(scan, log: bytes) -> None:
    place = log.index(HEAD.pack(6, 0)[:1], len(MAGIC) + 20)
    found = scan(log)
    second = found.blocks[1].body
    found = scan(log[: second.offset + CHUNK.size + 20])
    assert place < second.offset
    assert [each.cut for each in found.blocks] == [False, True]
    assert found.unread > 0


def test_the_walk_goes_on_behind_a_damaged_length(scan, log: bytes) -> None:
    first = scan(log).blocks[0].body
    data = bytearray(log)
    data[first.offset - 8 : first.offset] = bytes(8)  # its opcode has a length of 0
    data[first.offset - 9] = 0
    found = scan(bytes(data))
    assert [each.start for each in found.blocks] == [10]
    assert (found.finished, found.missing_chunks) == (True, 1)
    assert found.unread >= first.length


def test_messages_outside_of_chunks_form_runs(scan) -> None:
    messages = [message_bytes(1, n, 100 - n, 0, b"") for n in range(3)]
    note = record_bytes(Metadata(name="n", metadata={}))
    found = scan(MAGIC + record_bytes(CHANNEL) + messages[0] + messages[1] + note + messages[2])
    assert [(each.start, each.end, each.chunked) for each in found.blocks] == [(99, 100, False), (98, 98, False)]
    assert found.blocks[0].body.length == 2 * len(messages[0])


def test_more_chunks_than_allowed_are_left_out_and_told(scan, log: bytes) -> None:
    found = scan(log, replace(DEFAULT_LIMITS, chunks=1))
    assert (len(found.blocks), found.stopped, found.finished) == (1, True, True)
    assert "chunks=1" in str(found.refused)
    found = scan(log, replace(DEFAULT_LIMITS, total=1, ratio=0))
    assert (len(found.blocks), found.dropped) == (0, 2)


def test_definitions_are_kept_as_far_as_there_is_room_for_them() -> None:
    scan = Scan(1, replace(DEFAULT_LIMITS, definitions=100))
    body = record_bytes(CHANNEL)[HEAD.size :]
    other = record_bytes(replace(CHANNEL, topic="b"))[HEAD.size :]
    define(scan, 4, body)
    define(scan, 4, body)
    define(scan, 4, other)
    assert (scan.channels, scan.conflicts, scan.damaged) == ({1: CHANNEL}, {1}, set())
    define(scan, 4, b"\1")
    assert len(scan.damaged) == 1
    define(scan, 3, record_bytes(Schema(id=1, data=bytes(90), encoding="e", name="n"))[HEAD.size :])
    assert (scan.schemas, len(scan.damaged)) == ({}, 2)
    assert "definitions=100" in str(scan.refused)


def test_what_is_damaged_is_none() -> None:
    assert parse(Channel, b"\1\0") is None
    assert parse_footer(b"") is None
    assert parse_footer(bytes(20) + MAGIC) is None


def test_an_attachment_with_another_checksum_is_damaged(scan, log: bytes) -> None:
    extras = scan(log).blocks[1].extras
    data = bytearray(log)
    data[extras.offset + extras.length - 1] ^= 1
    found = scan(bytes(data))
    with pytest.raises(ValueError, match="checksum"):
        read_attachment(scan.file, found.blocks[1].extras)


def test_a_block_is_named_by_its_place() -> None:
    block = Block(2, Span(0, 10), 0, 0, chunked=True)
    record = message_bytes(1, 7, 5, 6, b"x")
    (entry,) = load_block(record, block, Scan(1), {})
    assert (entry.order, entry.published) == (2 << 32, 6)
