from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from riot_bus.log.engine.blocks import heads_of, message_bytes
from riot_bus.types.capabilities import Offer
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.batch import Batch
from riot_bus_logtools.editing.edit import LatchedMessages

START = 100
DEPTHS = {"map": 1, "path": 2, "scan": None, "odd": 0}


class Adapter:
    """Publishes topics that keep some messages for late joiners."""

    def offer(self, topic: str, *, name: str | None, domain: int | None) -> Offer | None:
        if topic == "broken":
            raise ConfigError("no such quality of service")
        return Offer(topic, depth=DEPTHS[topic]) if topic in DEPTHS else None

    def clock(self, topics: Any, *, domain: int | None) -> None:
        return None


def made(rows: list[tuple[int, int, bytes]]) -> Batch:
    """Return a batch of messages with these edits, times and payloads."""
    records = [message_bytes(edit, 0, time, time, payload) for edit, time, payload in rows]
    ends = np.cumsum([len(each) for each in records], dtype=np.int64)
    starts = ends - np.array([len(each) for each in records], np.int64)
    edits, times, _ = zip(*rows, strict=True)
    return Batch(b"".join(records), starts, ends, np.array(edits, np.int32), np.array(times, np.uint64))


def latched(*topics: str, original: bool = False) -> LatchedMessages:
    edits: Any = [SimpleNamespace(topic=topic, original=original) for topic in topics]
    adapters: Any = [object(), Adapter()]
    return LatchedMessages(START, edits, adapters)


def told(batch: Batch) -> list[tuple[int, int, bytes]]:
    """Return edit, time and payload of each message; the time in the record is the same."""
    assert heads_of(batch.buffer, batch.start)["time"].tolist() == batch.time.tolist()
    rows = zip(batch.edit.tolist(), batch.time.tolist(), batch.end.tolist(), strict=True)
    return [(edit, time, bytes(batch.buffer[end - 1 : end])) for edit, time, end in rows]


def test_a_slice_begins_with_the_last_messages_before_it() -> None:
    messages = latched("map", "path", "scan")
    first = made([(0, 10, b"a"), (1, 20, b"b"), (0, 30, b"c"), (2, 40, b"d"), (1, 50, b"e")])
    assert told(messages.run(first.where(messages.wanted(first)))) == []
    second = made([(1, 60, b"f"), (0, 99, b"g"), (2, 100, b"h"), (0, 150, b"i")])
    found = messages.run(second.where(messages.wanted(second)))
    assert told(found) == [(1, 100, b"e"), (1, 100, b"f"), (0, 100, b"g"), (2, 100, b"h"), (0, 150, b"i")]
    assert found.changed is not None
    assert found.changed.tolist() == [1, 1, 0, -1, -1]  # only what was moved counts as changed
    assert told(messages.run(made([(0, 160, b"j")]))) == [(0, 160, b"j")]
    assert told(messages.rest()) == []


def test_a_slice_without_messages_has_what_is_latched() -> None:
    messages = latched("map")
    messages.run(made([(0, 10, b"a"), (0, 20, b"b")]))
    assert told(messages.rest()) == [(0, 100, b"b")]
    assert told(messages.rest()) == []


@pytest.mark.parametrize("topic", ["scan", "odd", "broken", "unknown"])
def test_of_other_topics_only_the_slice_is_wanted(topic: str) -> None:
    batch = made([(0, 99, b""), (0, 100, b"")])
    assert latched(topic).wanted(batch).tolist() == [False, True]


def test_originals_are_never_latched() -> None:
    batch = made([(0, 99, b"")])
    assert latched("map").wanted(batch).tolist() == [True]
    assert np.count_nonzero(latched("map", original=True).wanted(batch)) == 0
