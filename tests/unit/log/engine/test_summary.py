"""The summary is believed only where it agrees with itself and with the file."""

import os
import struct

import pytest

from riot_bus.log.engine.summary import read_summary
from riot_bus.log.info import log_info
from tests.log_mutants import COUNT, START, bases, foreign, ours


def summary_of(path, data):
    path.write_bytes(data)
    file = os.open(path, os.O_RDONLY)
    try:
        return read_summary(file)
    finally:
        os.close(file)


@pytest.mark.parametrize("base", sorted(bases()))
def test_what_it_says_is_what_the_file_holds(tmp_path, base):
    path = tmp_path / "a.mcap"
    found = summary_of(path, bases()[base])
    assert found is not None
    told, read = log_info(path, scan=False), log_info(path, scan=True)
    assert (told.scanned, read.scanned) == (False, True)
    for one, other in zip(told.topics, read.topics, strict=True):
        assert (one.topic, one.key, one.type, one.encoding) == (other.topic, other.key, other.type, other.encoding)
        assert (one.count, one.originals) == (other.count, other.originals)
        assert one.first <= other.first <= other.last <= one.last
        assert (one.bytes, other.bytes > 0) == (None, True)
    for name in ("count", "start", "end", "profile", "library", "metadata", "chunks", "size", "account"):
        assert getattr(told, name) == getattr(read, name), name


@pytest.mark.parametrize("base", ["ours zstd", "foreign zstd", "foreign unchunked"])
def test_every_flipped_bit_of_a_signed_summary_is_noticed(tmp_path, base):
    data = bases()[base]
    start = struct.unpack_from("<Q", data, len(data) - 28)[0]
    for place in range(start, len(data), 3):
        raw = bytearray(data)
        raw[place] ^= 4
        assert summary_of(tmp_path / "a.mcap", bytes(raw)) is None, place


def test_a_log_without_one_is_read(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(ours("zstd")[:-200])
    found = log_info(path, scan=False)
    assert found.scanned
    assert found.loss.unfinished


def test_a_chunk_that_is_not_where_it_should_be(tmp_path):
    raw = bytearray(foreign("zstd"))
    raw[find_chunk(raw)] = 0x86
    assert summary_of(tmp_path / "a.mcap", bytes(raw)) is None
    (tmp_path / "a.mcap").write_bytes(raw)
    assert log_info(tmp_path / "a.mcap").loss.chunks == 1


def find_chunk(data):
    position = 8
    while data[position] != 6:
        position += 9 + struct.unpack_from("<Q", data, position + 1)[0]
    return position


def test_small_logs_are_read(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(foreign("zstd"))
    found = log_info(path)
    assert found.scanned
    assert (found.count, found.start, found.seconds) == (COUNT, START, (COUNT - 1) / 1e9)
