"""The work on logs with very many channels grows with their number, and no faster."""

import json

import numpy as np
import pytest

from riot_bus.log import reader as reader_module
from riot_bus.log.reader import LogReader
from riot_bus.log.tables import plan, ranges
from riot_bus.log.tables.blocks import load_ahead
from riot_bus.log.tables.plan import log_registry, topic_types
from riot_bus.log.tables.ranges import field_ranges
from riot_bus.plugins import PluginKind
from riot_bus.vocabulary.errors import ConfigError
from tests.log_mutants import START, channel, chunk, message, schema, whole

COUNT = 50


@pytest.fixture
def path(tmp_path):
    """Each chunk has all channels, and one chunk has none."""
    path = tmp_path / "a.mcap"
    types = b"".join(schema(n + 1, f"p/msg/T{n}", b"uint8 x\nuint8 y\n") for n in range(COUNT))
    names = b"".join(channel(n + 1, f"/t{n}", n + 1) for n in range(COUNT))
    rows = b"".join(message(n, n % COUNT + 1, b"\0\1\0\0\7\7") for n in range(4 * COUNT))
    late = message(0, 1, b"", time=(1 << 64) - 1)
    path.write_bytes(whole(types + names, chunk(rows), chunk(b""), chunk(late + rows[: len(rows) // 2])))
    return path


def test_rows_by_channel(path):
    with LogReader(path) as reader:
        blocks = list(load_ahead(reader, reader.blocks(), memory=1 << 20, threads=0))
        for block in blocks:
            found = dict(block.by_channel())
            assert sorted(found) == np.unique(block.channels).tolist()
            for number, rows in found.items():
                assert rows.tolist() == block.rows_of(number, 0, 1 << 64).tolist()
    assert sum(len(block.heads) for block in blocks) == 6 * COUNT + 1


def test_named_topics_are_looked_up_once(path):
    names = [f"/t{n}" for n in range(COUNT)]
    with LogReader(path) as reader:
        before = reader_module._choice.cache_info()
        assert len(list(reader.messages(topics=names, end=START + 10_000))) == 6 * COUNT
        after = reader_module._choice.cache_info()
    assert after.hits + after.misses == before.hits + before.misses + 1


def test_plug_ins_are_looked_up_once(path, monkeypatch):
    looks = []
    targets = PluginKind.targets
    monkeypatch.setattr(PluginKind, "targets", lambda self: looks.append(self.noun) or targets(self))
    with LogReader(path) as reader:
        registry = log_registry(reader)
        assert all(registry.type_of(f"/t{n}") is not None for n in range(COUNT))
    assert looks.count("codec") <= 2


def test_fields_of_types_are_listed_up_to_a_limit(path, monkeypatch):
    monkeypatch.setattr(plan, "_MOST_LISTED", 10)
    with LogReader(path) as reader:
        found = [listing for _, listing in topic_types(reader, log_registry(reader))]
        assert [len(each.fields) for each in found].count(2) == 5
        assert sum("name this topic with --topics" in each.problem for each in found) == COUNT - 5
        one = topic_types(reader, log_registry(reader), ["/t49"])
    assert [len(listing.fields) for _, listing in one] == [2]


def test_ranges_of_very_many_fields_are_refused(path, monkeypatch):
    monkeypatch.setattr(ranges, "_MOST_IN_ALL", 10)
    with LogReader(path) as reader:
        with pytest.raises(ConfigError, match="more than 10 fields") as caught:
            field_ranges(reader)
        assert "--topics" in (caught.value.hint or "")
        assert json.dumps([each.count for each in field_ranges(reader, topics=["/t3"])]) == "[6]"
