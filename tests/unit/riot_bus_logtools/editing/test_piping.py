from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.records import Channel

from riot_bus.log import layout
from riot_bus.log.engine.blocks import heads_of, message_bytes
from riot_bus.log.reader import channel_source
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.editing.batch import Batch
from riot_bus_logtools.editing.piping import Piping
from riot_bus_logtools.editing.result import EditCounts

KEYS = ("a", "b", "new")
Row = tuple[int, str, bytes]


class Act:
    """An interceptor of messages of the key `a`."""

    topics = ("a",)

    def __init__(self, action: Callable[[Any], object]) -> None:
        self.message = action


class Bench:
    """Channels of three keys, of which interceptors see the first."""

    def __init__(self, action: Callable[[Any], object]) -> None:
        self.edits = []
        for number, key in enumerate(KEYS):
            source = channel_source(Channel(number, key, "", {layout.KEY: key}, 0), None)
            target = SimpleNamespace(channel=SimpleNamespace(id=10 + number), source=source)
            self.edits.append(SimpleNamespace(
                topic=SimpleNamespace(name=f"/{key}"), source=source, target=target, counts=EditCounts(key, kept=100),
                piped=key == "a",
            ))  # fmt: skip
        table: Any = SimpleNamespace(edits=self.edits, edit_of_key=lambda message: KEYS.index(message.key))
        self.refused: list[str] = []
        pipeline = Pipeline([Act(action)], registry=TypeRegistry(()), provenance=False)
        pipeline.start()
        self.piping = Piping(pipeline, table, self.refused.append)

    def run(self, *rows: Row, bound: int | None = None) -> list[Row]:
        records = [message_bytes(KEYS.index(key), 0, time, time, payload) for time, key, payload in rows]
        ends = np.cumsum([len(each) for each in records], dtype=np.int64)
        starts = ends - np.array([len(each) for each in records], np.int64)
        edits, times = np.array([KEYS.index(key) for _, key, _ in rows], np.int32), [time for time, _, _ in rows]
        return told(self.piping.run(Batch(b"".join(records), starts, ends, edits, np.array(times, np.uint64)), bound))

    def counts(self) -> dict[str, tuple[int, int]]:
        return {each.topic: (each.kept - 100, each.added) for each in (edit.counts for edit in self.edits)}


def told(batch: Batch) -> list[Row]:
    """Return time, key and payload of each message; the record of one that was made has its channel and time."""
    heads = heads_of(batch.buffer, batch.start)
    assert heads["time"].tolist() == batch.time.tolist()
    assert all(channel in (edit, 10 + edit) for channel, edit in zip(heads["channel"], batch.edit, strict=True))
    rows = zip(batch.time.tolist(), batch.edit.tolist(), batch.start.tolist(), batch.end.tolist(), strict=True)
    return [(time, KEYS[edit], bytes(batch.buffer[start + 31 : end])) for time, edit, start, end in rows]


ROWS: tuple[Row, ...] = ((10, "a", b"1"), (10, "b", b"2"), (20, "a", b"3"), (30, "b", b"4"))


def test_what_nobody_changes_stays_as_it_is() -> None:
    bench = Bench(lambda event: None)
    assert bench.run(*ROWS) == list(ROWS)
    assert bench.counts() == {"a": (0, 0), "b": (0, 0), "new": (0, 0)}


def test_changed_messages_keep_their_place_and_dropped_ones_are_not_kept() -> None:
    bench = Bench(lambda event: event.drop() if event.payload == b"3" else event.replace(b"changed"))
    assert bench.run(*ROWS) == [(10, "a", b"changed"), (10, "b", b"2"), (30, "b", b"4")]
    assert bench.counts()["a"] == (-1, 0)


def test_delayed_messages_come_when_they_are_due_even_if_that_is_in_a_later_batch() -> None:
    bench = Bench(lambda event: event.delay(30e-9))
    assert bench.run(*ROWS, bound=31) == [(10, "b", b"2"), (30, "b", b"4")]
    assert bench.run((35, "b", b"5"), (45, "b", b"6"), bound=46) == [(35, "b", b"5"), (40, "a", b"1"), (45, "b", b"6")]
    assert told(bench.piping.rest()) == [(50, "a", b"3")]
    assert bench.counts()["a"] == (0, 0)


def test_messages_that_an_interceptor_makes_follow_the_one_that_it_saw() -> None:
    bench = Bench(lambda event: event.add(Message(event.message.time, "new", event.payload + b"!")))
    assert bench.run(*ROWS[:3]) == [
        (10, "a", b"1"),
        (10, "new", b"1!"),
        (10, "b", b"2"),
        (20, "a", b"3"),
        (20, "new", b"3!"),
    ]
    assert bench.counts() == {"a": (0, 0), "b": (0, 0), "new": (0, 2)}


def test_times_that_no_log_can_hold_are_refused() -> None:
    bench = Bench(lambda event: event.delay(1e12))
    assert bench.run(*ROWS[:1]) == told(bench.piping.rest()) == []
    assert (bench.refused, bench.counts()["a"]) == (["/a"], (-1, 0))
