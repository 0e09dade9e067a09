import random
import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from riot_bus.log import columns, iter_columns
from riot_bus.log.info import log_info
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions
from riot_bus_logtools.export.export import export_table
from tests.tiers import scaled

KEYS = ["a", "b/c", "d"]


def write(path: Path, log: list[Message], compression: str = "none", chunk_bytes: int = 1 << 20) -> bytes:
    with LogWriter(path, LogSettings(compression=compression, chunk_bytes=chunk_bytes)) as writer:
        for each in log:
            writer.write(each)
    return path.read_bytes()


def chunks(path: Path) -> list[tuple[int, int]]:
    """From where to where the records of each chunk stand in the file, as they are stored."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    found = []
    for each in summary.chunk_indexes:
        end = each.chunk_start_offset + each.chunk_length
        found.append((end - each.compressed_size, end))
    return sorted(found)


def read(path: Path, *, salvage: bool) -> tuple[list[Message], object]:
    with LogReader(path, salvage=salvage) as reader:
        return list(reader.messages()), reader.loss


def log_of(count: int, size: int = 40) -> list[Message]:
    draw = random.Random(count)
    return [
        Message(10**18 + n, KEYS[n % 3], draw.randbytes(size), attachment=b"%d" % n if n % 4 == 0 else None, sequence=n)
        for n in range(count)
    ]


def test_one_wrong_byte_costs_one_message_at_most(tmp_path):
    path, log = tmp_path / "a.mcap", log_of(12)
    whole = write(path, log)
    (begin, end), *_ = chunks(path)
    at = whole.index(log[7].payload)
    path.write_bytes(whole[: at + 3] + bytes([whole[at + 3] ^ 1]) + whole[at + 4 :])
    found, loss = read(path, salvage=False)
    assert (found, loss.chunks, loss.salvaged) == ([], 1, 0)
    found, loss = read(path, salvage=True)
    assert [n for n in range(12) if found[n] != log[n]] == [7]  # nobody can tell: it is what was stored
    assert (loss.chunks, loss.salvaged, loss.salvageable) == (1, 12, 0)
    assert "12 messages of them salvaged, unverified" in str(loss)
    for place in range(begin, end):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x80]) + whole[place + 1 :])
        found, loss = read(path, salvage=True)
        assert len([each for each in log if each in found]) >= len(log) - 1
        assert len(found) >= len(log) - 1
        assert loss.chunks == 1


def test_info_says_what_could_be_salvaged_and_edit_does_it(tmp_path):
    path, out, log = tmp_path / "a.mcap", tmp_path / "b.mcap", log_of(50)
    whole = write(path, log, chunk_bytes=1000)
    begin, _ = chunks(path)[1]
    path.write_bytes(whole[: begin + 9] + b"\xff" + whole[begin + 10 :])
    info = log_info(path)
    assert info.loss.chunks == 1
    assert info.loss.salvageable > 5
    assert "could be salvaged" in str(info.loss)
    kept = edit(EditOptions(inputs=[path], output=out))
    assert kept.total().kept == info.count
    saved = edit(EditOptions(inputs=[path], output=out, force=True, salvage=True))
    assert saved.total().kept == info.count + info.loss.salvageable == 49
    assert "unverified" in saved.losses[str(path)]
    found, loss = read(out, salvage=False)
    assert not loss
    assert found == read(path, salvage=True)[0]
    assert [each for each in log if each not in found] == [found_at(log, whole, begin)]


@pytest.mark.parametrize("threads", [0, 2])
def test_columns_and_tables_take_what_an_index_confirms_if_they_are_told_so(tmp_path, threads):
    path, out = tmp_path / "a.mcap", tmp_path / "a.csv"
    log = [Message(10**18 + n, "a", b'{"x": %3d}' % n, encoding="application/json", sequence=n) for n in range(90)]
    whole = write(path, log, chunk_bytes=1000)
    at = whole.index(log[40].payload)
    path.write_bytes(whole[: at - 22] + b"\xff" + whole[at - 21 :])
    found = columns(path, ["a:x"], threads=threads)
    column = found["a:x"]
    assert found.loss.chunks == 1
    assert "--salvage" in str(found.loss.hint)
    assert len(column) < 90
    saved = columns(path, ["a:x"], threads=threads, salvage=True)
    column = saved["a:x"]
    assert column.values.tolist() == [n for n in range(90) if n != 40]
    assert (np.diff(column.order) > 0).all()
    before, after = (int(column.order[column.values == n][0]) for n in (39, 41))
    assert after - before == 2  # places are those in the file as it was written
    assert (saved.loss.chunks, saved.loss.hint) == (1, None)
    assert 0 < saved.loss.salvaged < 90
    parts = [part["a:x"].values for part in iter_columns(path, ["a:x"], threads=threads, salvage=True)]
    assert np.concatenate(parts).tolist() == column.values.tolist()
    assert export_table(path, ["a:x"], out).rows < 89
    assert export_table(path, ["a:x"], out, force=True, salvage=True).rows == 89


def found_at(log: list[Message], whole: bytes, begin: int) -> Message:
    return next(each for each in log if begin < whole.index(each.payload))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_compressed_chunks_are_read_up_to_the_damage(tmp_path, compression):
    path = tmp_path / "a.mcap"
    draw = random.Random(7)
    log = [Message(10**18 + n, KEYS[n % 3], bytes(draw.choices(b"abcdefg", k=900)), sequence=n) for n in range(1000)]
    whole = write(path, log, compression)
    (begin, end), *_ = chunks(path)
    at = begin + (end - begin) * 3 // 4
    path.write_bytes(whole[:at] + bytes(512) + whole[at + 512 :])
    found, loss = read(path, salvage=True)
    assert loss.chunks == 1
    assert found[:450] == log[:450]
    assert loss.salvaged == len(found) < len(log)


def test_chunks_without_an_index_or_a_sound_head_are_left_out(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        from mcap.writer import IndexType

        writer = Writer(file, compression=CompressionType.NONE, index_types=IndexType.NONE)
        writer.start()
        channel = writer.register_channel("/a", "raw", 0)
        for n in range(20):
            writer.add_message(channel, n, b"payload", n)
        writer.finish()
    whole = path.read_bytes()
    at = whole.index(b"payload")
    path.write_bytes(whole[:at] + b"P" + whole[at + 1 :])
    assert read(path, salvage=True)[0] == []
    whole = write(path, log_of(20))
    begin, _ = chunks(path)[0]
    for place, value in ((begin - 24, 1 << 40), (begin - 24, 1 << 63), (begin - 8, 0)):
        damaged = bytearray(whole)
        damaged[place : place + 8] = struct.pack("<Q", value)
        path.write_bytes(damaged)
        assert len(read(path, salvage=True)[0]) <= 20


messages = st.builds(
    Message,
    time=st.integers(0, 50),
    key=st.sampled_from(KEYS),
    payload=st.binary(max_size=30),
    attachment=st.none() | st.binary(max_size=4),
    sequence=st.integers(0, 2**33),
)


@settings(max_examples=scaled(60), deadline=None)
@given(st.lists(messages, min_size=1, max_size=30), st.integers(50, 2000), st.data())
def test_so_many_wrong_bytes_in_chunks_cost_so_many_messages(log, chunk_bytes, data):
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "a.mcap"), Path(folder, "b.mcap")
        damaged = bytearray(write(path, log, "none", chunk_bytes))
        spans = chunks(path)
        places = [place for begin, end in spans for place in range(begin, end)]
        wrong = data.draw(st.lists(st.sampled_from(places), max_size=4))
        for at in wrong:
            damaged[at] ^= data.draw(st.integers(1, 255))
        path.write_bytes(damaged)
        found, loss = read(path, salvage=True)
        assert len(found) <= len(log)
        rest = list(log)
        for each in found:
            if each in rest:
                rest.remove(each)
        assert len(rest) <= len(wrong)
        assert bool(loss) == bool(loss.chunks)
        sound, _ = read(path, salvage=False)
        assert len(found) - len(sound) == loss.salvaged == log_info(path).loss.salvageable
        result = edit(EditOptions(inputs=[path], output=out, salvage=True))
        edited, other = read(out, salvage=False)
        assert not other
        assert sorted(edited, key=repr) == sorted(found, key=repr)
        assert bool(result.losses) == bool(loss)


@settings(max_examples=scaled(60), deadline=None)
@given(st.lists(messages, min_size=1, max_size=20), st.sampled_from(["zstd", "lz4", "none"]), st.data())
def test_whatever_is_wrong_it_never_raises_and_adds_nothing(log, compression, data):
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "a.mcap"), Path(folder, "b.mcap")
        whole = bytearray(write(path, log, compression, 300))
        for _ in range(data.draw(st.integers(0, 6))):
            whole[data.draw(st.integers(8, len(whole) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(whole[: data.draw(st.integers(8, len(whole)))])
        found, loss = read(path, salvage=True)
        sound, less = read(path, salvage=False)
        assert len(sound) <= len(found) <= 2 * len(log)
        assert loss.salvaged or len(found) == len(sound)
        assert bool(loss) == bool(less)
        edit(EditOptions(inputs=[path], output=out, salvage=True))
        log_info(path)
