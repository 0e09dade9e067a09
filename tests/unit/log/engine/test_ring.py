from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from riot_bus.log.engine.ring import Ring
from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.manual_clock import ManualClock

SECOND = 10**9


def filled(ring: Ring, count: int, *, size: int = 10, chunk_bytes: int = 200) -> LogWriter:
    writer = LogWriter("ring", LogSettings(chunk_bytes=chunk_bytes), storage=ring, clock=ManualClock())
    for number in range(count):
        key = "rare" if number == 0 else f"k{number % 3}"
        attachment = b"x" if number % 2 else None
        body = b"%d" % number + bytes(size)
        writer.write(Message(SECOND * number, key, body, sequence=number, attachment=attachment))
    writer.flush()
    return writer


def numbers(path: Path) -> list[int]:
    return [each.sequence for each in read_log(path)]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_the_last_seconds_become_a_log_that_every_tool_reads(tmp_path: Path, compression: str) -> None:
    ring, path = Ring(30, most_bytes=1 << 20, compression=compression), tmp_path / "a.mcap"
    writer = filled(ring, 200)
    schemas, channels = writer.definitions()
    content = ring.content()
    size = content.write(
        path, profile="", library="test", schemas=schemas, channels=channels, notes=[("n", {"a": "b"})]
    )
    assert size == path.stat().st_size
    found = numbers(path)
    assert found == list(range(found[0], 200))
    assert 160 <= found[0] <= 169
    assert sum(content.messages.values()) == len(found)
    with LogReader(path) as reader:
        assert not reader.loss
        assert [each.attachment for each in reader.messages()] == [b"x" if number % 2 else None for number in found]
        assert list(reader.notes("n")) == [{"a": "b"}]
        assert {source.topic for source in reader.sources().values()} == {"k0", "k1", "k2"}
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(found)
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(found)


def test_it_goes_on_after_it_was_written(tmp_path: Path) -> None:
    ring = Ring(1000, most_bytes=1 << 20)
    writer = filled(ring, 10)
    ring.content().write(tmp_path / "a.mcap", profile="", library="test", schemas=[], channels=writer.definitions()[1])
    writer.write(Message(10 * SECOND, "k1", b"10", sequence=10))
    writer.flush()
    ring.content().write(tmp_path / "b.mcap", profile="", library="test", schemas=[], channels=writer.definitions()[1])
    assert (numbers(tmp_path / "a.mcap"), numbers(tmp_path / "b.mcap")) == (list(range(10)), list(range(11)))
    writer.close()
    assert sum(ring.content().messages.values()) == 11


def test_its_memory_is_bounded() -> None:
    ring = Ring(10**6, most_bytes=20_000, compression="none")
    filled(ring, 1000, size=1000, chunk_bytes=5000)
    assert 10_000 < ring.size <= 20_000
    assert ring.cut
    assert max(ring.content().messages) <= 4
    assert ring.content().end == 999 * SECOND


def test_a_chunk_that_alone_is_too_large_is_kept() -> None:
    ring = Ring(10**6, most_bytes=10, compression="none")
    filled(ring, 3, size=1000, chunk_bytes=500)
    assert sum(ring.content().messages.values()) == 1


def test_compressions_are_checked() -> None:
    with pytest.raises(ConfigError, match="did you mean 'zstd'"):
        Ring(1, most_bytes=1, compression="zst")
