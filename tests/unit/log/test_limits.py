"""Small files take neither large memory nor long time; what is beyond a limit is named."""

import random
import struct
import subprocess
import sys
import zlib

import pytest
import zstandard

from riot_bus.log.engine.blocks import EXTRAS
from riot_bus.log.engine.limits import LogLimits
from riot_bus.log.info import log_info
from riot_bus.log.limits import VARIABLE, lifted, tight_limits
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.inputs import InputLog
from tests.log_mutants import attachment, channel, chunk, message, record, schema, statistics, text, whole

GIB = 1 << 30


def definitions():
    return schema(1, "x/msg/X", b"uint8 x") + channel(1, "/x")


def entry(at, payload=b""):
    return message(0, payload=payload, time=at)


def bomb(path, size=GIB - 200):
    """One message of zeros that takes 32000 times as many bytes as the file."""
    head = entry(5)[9:]
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=9 + len(head) + size)
    zeros = bytes(1 << 24)
    packed = packer.compress(struct.pack("<BQ", 5, len(head) + size) + head)
    for begin in range(0, size, len(zeros)):
        packed += packer.compress(zeros[: size - begin])
    packed += packer.flush()
    zeros = chunk(b"", packed=packed, size=31 + size, checksum=0, start=5, end=5)
    path.write_bytes(whole(definitions(), zeros, summary=definitions() + statistics(1)))
    return path


def crowd(path, count, data=None):
    """As many chunks of a message, all from the same time on."""
    each = [chunk(data or entry(n), start=0, end=count) for n in range(count)]
    path.write_bytes(whole(definitions(), *each, summary=definitions() + statistics(count, chunks=count)))
    return path


READ = """
import resource, sys
import numpy
from riot_bus.log.info import log_info
from riot_bus.log.reader import LogReader
import riot_bus.log.tables.blocks
pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, [pages * resource.getpagesize() + (1 << 28)] * 2)
for loss in (log_info(sys.argv[1]).loss, log_info(sys.argv[1], scan=False).loss):
    assert (loss.beyond, loss.chunks) == (1, 0), loss
with LogReader(sys.argv[1], salvage=True) as reader:
    assert list(reader.messages()) == []
    print(reader.loss)
"""


def test_a_small_chunk_does_not_become_a_large_one(tmp_path):
    path = bomb(tmp_path / "a.mcap")
    assert path.stat().st_size < 40_000
    done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 chunks beyond the limits" in done.stdout
    assert "more than ratio=200; RIOT_LOG_LIMITS=ratio=" in done.stdout


def test_the_sentence_lifts_the_limit(tmp_path, monkeypatch):
    path = bomb(tmp_path / "a.mcap", size=1 << 20)
    limits = LogLimits(loose=1000)
    with LogReader(path, limits=limits) as reader:
        assert list(reader.messages()) == []
        needed = str(reader.loss).partition(f"{VARIABLE}=")[2].partition(" ")[0]
    monkeypatch.setenv(VARIABLE, needed)
    with LogReader(path, limits=lifted(limits)) as reader:
        assert [len(each.payload) for each in reader.messages()] == [1 << 20]
        assert not reader.loss


def test_blank_images_are_read(tmp_path):
    path = bomb(tmp_path / "a.mcap", size=8 << 20)
    assert log_info(path, limits=tight_limits()).count == 1


def test_editing_has_the_same_limits(tmp_path, monkeypatch):
    path = bomb(tmp_path / "a.mcap", size=1 << 20)
    monkeypatch.setenv(VARIABLE, "loose=1kB")
    log = InputLog(0, path)
    assert not len(log.batch(log.stored_blocks[0], lambda *_: 0))
    assert (log.loss.beyond, log.loss.chunks) == (1, 0)
    assert "ratio=200" in str(log.loss)


def zeros(path, count, *, size=100_000, extras=b""):
    """As many chunks, each with a message of zeros, that take 100 bytes."""
    each = extras + chunk(message(0, payload=bytes(size), time=5))
    path.write_bytes(whole(definitions(), each * count, summary=definitions() + statistics(count, chunks=count)))
    return path


def test_the_sum_of_all_chunks_is_limited_and_the_sentence_lifts_it(tmp_path, monkeypatch):
    path = zeros(tmp_path / "a.mcap", 40)
    limits = LogLimits(total=1_000_000, ratio=10)  # the file has 4 kB
    for scan in (True, None):
        found = log_info(path, scan=scan, limits=limits)
        assert (found.count, found.loss.beyond, found.loss.chunks) == (9, 31, 0)
        assert f"4001240 bytes in all chunks of {path.stat().st_size}, more than total=1000000" in found.loss.limit
    with LogReader(path, limits=limits) as reader:
        assert len(list(reader.messages())) == 9
        needed = str(reader.loss).partition(f"{VARIABLE}=")[2].partition(" ")[0]
    monkeypatch.setenv(VARIABLE, needed)
    with LogReader(path, limits=lifted(limits)) as reader:
        assert len(list(reader.messages())) == 40
        assert not reader.loss
    assert log_info(path, limits=LogLimits(total=1, ratio=1100)).count == 40  # as many times as large as the file


def test_the_sum_is_limited_where_no_summary_counts_chunks(tmp_path):
    path = zeros(tmp_path / "a.mcap", 40)
    path.write_bytes(path.read_bytes()[:-200])
    loss = log_info(path, limits=LogLimits(total=1_000_000, ratio=10)).loss
    assert (loss.beyond, loss.chunks, loss.unfinished) == (31, 0, True)


def test_extras_of_chunks_count_too(tmp_path):
    packed = zstandard.compress(bytes(1 << 20))
    path = zeros(tmp_path / "a.mcap", 40, size=0, extras=attachment(EXTRAS, packed))
    found = log_info(path, limits=LogLimits(total=10 << 20, ratio=10))
    assert (found.count, found.loss.beyond) == (9, 31)


def test_extras_that_hide_their_size_are_not_unpacked(tmp_path, monkeypatch):
    data = zstandard.compress(bytes(1 << 20))
    body = bytes(16) + text(EXTRAS) + text("x" * 60) + struct.pack("<Q", len(data)) + data
    path = zeros(tmp_path / "a.mcap", 3, extras=record(9, body + struct.pack("<I", zlib.crc32(body))))
    monkeypatch.setattr("riot_bus.log.layout.unpack_extras", None)
    assert log_info(path).count == 3


def test_a_chunk_that_lies_takes_no_room_from_others(tmp_path):
    path = tmp_path / "a.mcap"
    lie = chunk(b"", packed=b"x", size=1 << 60)
    path.write_bytes(whole(definitions(), lie, chunk(entry(5)), summary=definitions() + statistics(1, chunks=2)))
    found = log_info(path, limits=LogLimits(total=1000))
    assert (found.count, found.loss.beyond, found.loss.chunks) == (1, 0, 1)


@pytest.mark.parametrize(
    ("limits", "count", "sentence"),
    [
        ({"chunks": 40}, 40, "60 chunks beyond the limits (more than 40 chunks, more than chunks=40"),
        ({"chunk": 20}, 0, "100 chunks beyond the limits (31 bytes, more than chunk=20"),
        ({"definitions": 10}, 0, "more than definitions=10"),
    ],
)
def test_what_is_beyond_is_named(tmp_path, limits, count, sentence):
    path = crowd(tmp_path / "a.mcap", 100)
    with LogReader(path, limits=LogLimits(**limits)) as reader:
        assert len(list(reader.messages())) == count
        assert sentence in str(reader.loss)
        assert f"{VARIABLE}=" in str(reader.loss)
        assert (reader.loss.chunks, reader.loss.unfinished) == (0, False)
    for scan in (True, False):
        assert sentence in str(log_info(path, scan=scan, limits=LogLimits(**limits)).loss)


def test_a_chunk_of_too_many_messages(tmp_path):
    path = crowd(tmp_path / "a.mcap", 1, entry(0) * 1000)
    for limits, count in ((LogLimits(messages=999), 0), (LogLimits(messages=1000), 1000)):
        with LogReader(path, limits=limits) as reader:
            assert len(list(reader.messages())) == count
            assert (reader.loss.beyond, "messages=999" in str(reader.loss)) == ((0, False) if count else (1, True))
        assert log_info(path, scan=True, limits=limits).count == count


def test_scattered_messages_outside_of_chunks_are_read_together(tmp_path):
    path = tmp_path / "a.mcap"
    count = 10_000
    parts = [entry(count - n) + record(0x90, b"odd") + channel(1, "/x") for n in range(count)]
    path.write_bytes(whole(definitions(), *parts, summary=definitions() + statistics(count, chunks=0)))
    with LogReader(path, limits=LogLimits(chunks=2)) as reader:
        assert [each.time for each in reader.messages()] == list(range(1, count + 1))
        assert not reader.loss


def test_what_waits_is_bounded_and_late_messages_are_counted(tmp_path):
    draw = random.Random(1)
    each = [chunk(b"".join(entry(draw.randrange(1000)) for _ in range(10)), start=0, end=1000) for _ in range(50)]
    path = tmp_path / "a.mcap"
    path.write_bytes(whole(definitions(), *each, summary=definitions() + statistics(500, chunks=50)))
    with LogReader(path, limits=LogLimits(held=40_000)) as reader:
        found = [message.time for message in reader.messages()]
        assert len(found) == 500
        assert reader.loss.unsorted > 0
    with LogReader(path) as reader:
        assert [message.time for message in reader.messages()] == sorted(found)
        assert not reader.loss


def test_the_environment_changes_limits(monkeypatch):
    assert lifted() == LogLimits()
    monkeypatch.setenv(VARIABLE, "chunk=2GiB, ratio=7")
    assert lifted() == LogLimits(chunk=2 << 30, ratio=7)
    assert (tight_limits().chunk, tight_limits().ratio) == (2 << 30, 7)
    monkeypatch.setenv(VARIABLE, "chunck=1")
    with pytest.raises(ConfigError, match="unknown limit 'chunck'") as caught:
        lifted()
    assert (caught.value.where, "chunk" in (caught.value.hint or "")) == (VARIABLE, True)
    monkeypatch.setenv(VARIABLE, "chunk=big")
    with pytest.raises(ConfigError, match="'big' is not a size"):
        lifted()


def test_tight_limits_are_tighter_and_shared():
    one, many = tight_limits(), tight_limits(100)
    assert one.chunk < LogLimits().chunk
    assert one.chunks < LogLimits().chunks
    assert many.chunks < one.chunks
    assert many.held == one.held // 100
