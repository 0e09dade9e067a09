from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.engine import chunk as module
from riot_bus.log.engine.chunk import ChunkBuilder, Draft

ROWS = st.lists(
    st.tuples(st.integers(1, 4), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1), st.binary(max_size=40)),
    max_size=30,
)


def draft(rows: list[tuple[int, int, int, bytes]], definitions: list[bytes]) -> Draft:
    builder = ChunkBuilder()
    for record in definitions:
        builder.define(record)
    assert not builder.fill(iter([(c, s, t, t, payload, None) for c, s, t, payload in rows]), 1 << 30)
    assert builder.count == len(rows)
    found = builder.end()
    assert (builder.count, builder.size) == (0, 0)
    return found


@pytest.mark.parametrize("few", [0, 128], ids=["numpy", "loop"])
@settings(deadline=None)
@given(rows=ROWS, definitions=st.lists(st.binary(max_size=9), max_size=3))
def test_a_chunk_and_its_index_agree_with_its_messages(
    few: int, rows: list[tuple[int, int, int, bytes]], definitions: list[bytes]
) -> None:
    made = draft(rows, definitions)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_FEW", few)
        chunk = made.chunk()
    data = b"".join(chunk.data)
    assert data.startswith(chunk.definitions)
    assert chunk.definitions == b"".join(definitions)
    assert len(data) == made.size
    assert dict(made.counts()) == chunk.counts
    assert chunk.counts == {c: sum(row[0] == c for row in rows) for c in {row[0] for row in rows}}
    assert (chunk.start, chunk.end) == (min((r[2] for r in rows), default=0), max((r[2] for r in rows), default=0))
    for channel, record in chunk.indexes.items():
        entries = record[15:]
        assert int.from_bytes(record[11:15], "little") == len(entries) == 16 * chunk.counts[channel]
        mine = [row for row in rows if row[0] == channel]
        for place, (_, sequence, time, payload) in enumerate(mine):
            entry = entries[16 * place : 16 * place + 16]
            assert int.from_bytes(entry[:8], "little") == time
            offset = int.from_bytes(entry[8:], "little")
            assert data[offset] == 5
            assert int.from_bytes(data[offset + 9 : offset + 11], "little") == channel
            assert int.from_bytes(data[offset + 11 : offset + 15], "little") == sequence
            assert data[offset + 31 : offset + 31 + len(payload)] == payload


@pytest.mark.parametrize("sizes", [[1 << 20], [10] * 50_000, [200_000] * 12, [10, 300_000, 10, 10, 300_000] * 4])
def test_large_chunks_are_made_in_pieces(sizes: list[int]) -> None:
    rows = [(1, number, number, bytes(size)) for number, size in enumerate(sizes)]
    made = draft(rows, [b"definition"])
    chunk = made.chunk()
    assert b"".join(chunk.data) == b"".join([b"definition", *made.parts])
    assert max(map(len, chunk.data)) <= max(*sizes, 1 << 17) + (1 << 17)
    assert len(chunk.data) <= 2 * len(sizes) + 1


def test_a_chunk_is_full_by_its_bytes_attachments_included() -> None:
    builder = ChunkBuilder()
    rows = iter([(1, 0, 0, 0, bytes(10), None), (1, 0, 0, 0, b"", {"a": bytes(100)}), (1, 0, 0, 0, b"", None)])
    assert builder.fill(rows, 150)
    assert builder.count == 2
    assert builder.end().extras == [(1, {"a": bytes(100)})]
    assert not builder.fill(rows, 150)
    assert builder.count == 1
