import random
import zlib
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.reader import make_reader

from riot_bus.log.engine.chunk import LARGE, ChunkBuilder
from riot_bus.log.engine.packing import COMPRESSIONS, PackedChunk, check_compression, worthwhile
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions

TEXT = b'{"x": 1.5, "name": "rover"}'
UNPACK = {
    "zstd": lambda data: zstandard.decompress(data, max_output_size=1 << 24),
    "lz4": lz4.frame.decompress,
    "none": bytes,
}


def noise(size: int, seed: int = 0) -> bytes:
    return random.Random(seed).randbytes(size)


def packed(*payloads: bytes, compression: str = "zstd") -> PackedChunk:
    builder = ChunkBuilder()
    builder.define(b"a definition")
    builder.fill(iter([(1, n, n, n, payload, None) for n, payload in enumerate(payloads)]), 1 << 40)
    chunk = builder.end().chunk()
    found = PackedChunk.of(chunk, compression)
    records = b"".join(chunk.data)
    assert UNPACK[found.compression](b"".join(found.data)) == records
    assert (found.size, found.checksum) == (len(records), zlib.crc32(records))
    return found


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_what_cannot_become_smaller_is_left_as_it_is(compression):
    assert packed(noise(1 << 20), compression=compression).compression == "none"
    assert packed(*(noise(LARGE, seed) for seed in range(16)), compression=compression).compression == "none"
    assert packed(TEXT * 50_000, compression=compression).compression == compression


@pytest.mark.parametrize(
    "payloads",
    [
        [TEXT] * 100,
        [noise(300, seed) for seed in range(1000)],  # small ones are not looked at
        [noise(LARGE - 1), TEXT * 100],
        [noise(900_000) + bytes(60_000)],  # a sixteenth is empty
        [bytes(60_000) + noise(900_000)],
        [bytes(b & 0x7F for b in noise(300_000))],
        [noise(300_000), *[TEXT] * 1000],
        [noise(300_000), TEXT * 10_000],
        [noise(300_000), noise(300_000)],  # an original, and what was delivered
        [noise(300_000), b"\0" + noise(300_000)[1:]],
    ],
)
def test_what_can_become_smaller_does(payloads):
    found = packed(*payloads)
    assert found.compression == "zstd"
    assert found.length < found.size


def test_a_look_at_a_huge_payload_takes_little(monkeypatch):
    seen = []
    monkeypatch.setitem(COMPRESSIONS, "zstd", lambda pieces: seen.append(pieces) or ())
    worthwhile("zstd", [memoryview(bytes(1 << 27))], 1 << 27)
    assert sum(len(piece) for pieces in seen for piece in pieces) <= 1 << 21


def test_unknown_compressions_are_refused():
    with pytest.raises(ConfigError, match="unknown compression 'zst'"):
        check_compression("zst", "here")


def compressions(path: Path) -> list[str]:
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        return [each.compression for each in sorted(summary.chunk_indexes, key=lambda one: one.chunk_start_offset)]


def test_a_log_may_have_both_and_editing_keeps_that(tmp_path):
    path, out = tmp_path / "in.mcap", tmp_path / "out.mcap"
    log = [Message(10**18 + n, f"a/{n % 3}", noise(1 << 20, n) if n % 3 == 0 else TEXT * 40_000) for n in range(6)]
    with LogWriter(path) as writer:
        for each in log:
            writer.write(each)
    assert compressions(path) == ["", "zstd", "zstd"] * 2
    with path.open("rb") as file:
        found = [each.data for _, _, each in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [each.payload for each in log]
    edit(EditOptions(inputs=[path], output=out))
    assert compressions(out) == compressions(path)
    edit(EditOptions(inputs=[path], output=out, force=True, drop=["a/1"], sort=True))
    assert set(compressions(out)) == {"", "zstd"}
    edit(EditOptions(inputs=[path], output=out, force=True, compression="lz4"))
    assert set(compressions(out)) == {"", "lz4"}
    with LogReader(out) as reader:
        assert [each.payload for each in reader.messages()] == [each.payload for each in log]
        assert not reader.loss
