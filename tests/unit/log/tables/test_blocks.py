"""Blocks as arrays, in the order asked for, with no more in memory than may be; the file is a fake."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from riot_bus.log.engine.blocks import Block, Records, Span, message_bytes
from riot_bus.log.tables.blocks import LATEST, LoadedBlock, load_ahead

Row = tuple[int, int, bytes]
"""Channel, time and payload of a message."""
MIXED: list[Row] = [(2, 50, b"a"), (1, 20, b"bc"), (2, 30, b""), (1, 2**63, b"late"), (3, 0, b"def")]


def block(number: int) -> Block:
    return Block(number, Span(0, 0), 0, 0, chunked=True)


def records(rows: list[Row], numbers: Any = None) -> Records:
    data, places = b"some other record", []
    for at, (channel, time, payload) in enumerate(rows):
        places.append(len(data))
        data += message_bytes(channel, at, time, time + 1, payload)
    return Records(data, np.array(places, np.int64), [], numbers)


class Reader:
    """A log of blocks; those in `broken` are damaged, those in `saved` have something left."""

    def __init__(self, blocks: list[list[Row]], *, broken: dict[int, list[Row] | None] | None = None) -> None:
        self.blocks = blocks
        self.broken = broken or {}
        self.begun: list[int] = []
        self.lost = SimpleNamespace(unknown={})
        self.size = 1 << 15

    def sources(self) -> dict[int, None]:
        return {1: None, 2: None}

    def claimed_size(self, block: Block) -> int:
        return self.size

    def load(self, block: Block, *, memory: int | None) -> Records:
        self.begun.append(block.number)
        if block.number in self.broken:
            raise ValueError("checksum")
        return records(self.blocks[block.number])

    def salvage(self, block: Block, problem: ValueError, *, memory: int | None) -> Records | None:
        assert str(problem) == "checksum"
        rest = self.broken[block.number]
        return None if rest is None else records(rest)

    def define(self, records: Records) -> None:
        pass


def loaded(rows: list[Row]) -> LoadedBlock:
    (found,) = load_ahead(fake(Reader([rows])), [block(0)], memory=1 << 20, threads=0)
    return found


def fake(reader: Reader) -> Any:
    return reader


def test_messages_are_found_by_channel_and_time() -> None:
    found = loaded(MIXED)
    assert found.rows_of(2, 0, LATEST + 1).tolist() == [0, 2]
    assert found.rows_of(2, 31, LATEST + 1).tolist() == [0]
    assert found.rows_of(2, 30, 50).tolist() == [2]  # the end is left out
    assert found.rows_of(9, 0, LATEST + 1).tolist() == []
    assert found.rows_of(3, 0, 1).tolist() == [4]


@pytest.mark.parametrize("high", [LATEST, LATEST + 1, 1 << 64])
def test_times_beyond_the_year_2262_are_never_found(high: int) -> None:
    found = loaded(MIXED)
    assert found.times.tolist() == [50, 20, 30, -1, 0]
    assert found.rows_of(1, 0, high).tolist() == [1]
    assert found.published(np.array([3, 4])).tolist() == [-1, 1]


def test_all_channels_at_once_are_as_one_by_one() -> None:
    found = loaded(MIXED)
    every = {channel: rows.tolist() for channel, rows in found.by_channel()}
    assert every == {each: found.rows_of(each, 0, LATEST + 1).tolist() for each in (1, 2, 3)}
    assert list(loaded([]).by_channel()) == []
    assert list(loaded([(1, 2**64 - 2, b"")]).by_channel()) == []


def test_payloads_are_those_of_the_rows() -> None:
    found = loaded(MIXED)
    assert list(found.payloads(np.array([4, 1, 2]))) == [b"def", b"bc", b""]
    assert found.lengths().tolist() == [1, 2, 0, 4, 3]


def test_places_in_the_file_are_ordered_by_block_then_by_message_also_where_some_are_lost() -> None:
    rows = np.arange(2)
    whole, rest = (
        LoadedBlock(block(number), records(MIXED[:2], numbers), np.empty(0), np.empty(0, np.int64))
        for number, numbers in ((3, None), (4, np.array([5, 9])))
    )
    assert [*whole.order(rows), *rest.order(rows)] == [3 << 32, (3 << 32) + 1, (4 << 32) + 5, (4 << 32) + 9]


@pytest.mark.parametrize("threads", [0, 1, 3])
def test_blocks_come_in_the_order_asked_for_and_damage_is_left_out(threads: int) -> None:
    blocks = [[(1, number, b"x")] for number in range(6)]
    reader = Reader(blocks, broken={1: None, 4: [(2, 77, b"left")]})
    found = list(load_ahead(fake(reader), [block(n) for n in (5, 4, 1, 0)], memory=1 << 20, threads=threads))
    assert [(each.block.number, each.times.tolist()) for each in found] == [(5, [5]), (4, [77]), (0, [0])]


def test_messages_of_unknown_channels_and_late_ones_are_counted() -> None:
    reader = Reader([MIXED, [(1, 5, b"")]])
    list(load_ahead(fake(reader), [block(0), block(1)], memory=1 << 20, threads=0))
    assert reader.lost.unknown == {0: 2, 1: 0}  # channel 3, and what came too late


@pytest.mark.parametrize(("memory", "most"), [(1 << 30, 5), (3 << 15, 3), (1, 1)])
def test_no_more_is_loaded_ahead_than_fits_into_memory(memory: int, most: int) -> None:
    reader = Reader([[(1, number, b"x")] for number in range(12)])
    for count, _ in enumerate(load_ahead(fake(reader), [block(n) for n in range(12)], memory=memory, threads=2)):
        assert len(reader.begun) - count <= most
    assert sorted(reader.begun) == list(range(12))


def test_what_nobody_takes_is_not_loaded() -> None:
    reader = Reader([[(1, number, b"x")] for number in range(12)])
    blocks = load_ahead(fake(reader), [block(n) for n in range(12)], memory=1 << 30, threads=1)
    next(blocks)
    blocks.close()
    assert len(reader.begun) <= 4
