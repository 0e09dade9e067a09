from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.inject.interceptor import Injector
from riot_bus.log.playback.ahead import AheadSource
from riot_bus.log.playback.sources import LogSource, MergedSource, PipedSource
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message, Qos


class Numbers:
    """A source of messages at given times."""

    def __init__(self, key, *times):
        self.key, self.times = key, times
        self.start, self.end = times[0], times[-1]
        self.read = 0

    def messages(self, start=None):
        for number, at in enumerate(self.times):
            if at >= (start or 0):
                self.read += 1
                yield Message(at, self.key, b'{"v": %d}' % number, sequence=number)


def write(path, *messages):
    with LogWriter(path, LogSettings(chunk_bytes=300)) as writer:
        for message in messages:
            writer.write(message)
    return LogReader(path)


def shown(source, start=None):
    return [(message.key, message.time) for message in source.messages(start)]


def test_merge_keeps_each_order_and_on_equal_times_that_of_the_sources():
    merged = MergedSource([Numbers("a", 1, 3, 3, 5), Numbers("b", 2, 3, 5)])
    assert shown(merged) == [("a", 1), ("b", 2), ("a", 3), ("a", 3), ("b", 3), ("a", 5), ("b", 5)]
    assert (merged.start, merged.end) == (1, 5)
    assert shown(merged, 3) == shown(merged)[2:]


def test_merge_between_start_and_end():
    merged = MergedSource([Numbers("a", 1, 3, 5), Numbers("b", 2, 4, 6)], start=2, end=5)
    assert shown(merged) == [("b", 2), ("a", 3), ("b", 4)]
    assert shown(merged, 0) == shown(merged)
    assert (merged.start, merged.end) == (2, 5)


def test_merge_of_nothing():
    merged = MergedSource([])
    assert (shown(merged), merged.start, merged.end) == ([], 0, 0)


def test_merge_reads_no_more_than_it_has_to():
    sources = [Numbers("a", *range(1000)), Numbers("b", *range(1000))]
    found = MergedSource(sources).messages()
    for _ in range(10):
        next(found)
    assert sum(source.read for source in sources) <= 12


@given(st.lists(st.lists(st.integers(0, 20), min_size=1).map(sorted), min_size=1, max_size=4), st.integers(0, 20))
def test_merge_holds_all_messages_by_time(times, start):
    sources = [Numbers(str(number), *each) for number, each in enumerate(times)]
    found = shown(MergedSource(sources), start)
    expected = sorted(((at, number) for number, each in enumerate(times) for at in each if at >= start))
    assert found == [(str(number), at) for at, number in expected]


def test_log_under_other_keys_and_at_another_time(tmp_path):
    qos = Qos(2, "block", express=True)
    log = [
        Message(100, "a", b"1", encoding="x", attachment=b"y", qos=qos, segment="s", sequence=7, publish_time=99),
        Message(101, "b", b"2"),
        Message(102, "c", b"", kind="delete", sequence=8),
    ]
    reader = write(tmp_path / "log.mcap", *log)
    whole = LogSource(reader)
    assert (list(whole.messages()), whole.start, whole.end) == (log, 100, 102)
    assert list(whole.messages(101)) == log[1:]
    source = LogSource(reader, {"a": "x/a", "c": "c"}, shift=-50)
    assert list(source.messages()) == [log[0].with_(key="x/a", time=50), log[2].with_(time=52)]
    assert list(source.messages(51)) == [log[2].with_(time=52)]
    assert (source.start, source.end) == (50, 52)


def test_recorded_topics_leave_originals_out(tmp_path):
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.write(Message(1, "a", b"{}", encoding="application/json"), role="original")
        writer.write(Message(1, "a", b"[]", encoding="application/json"))
        writer.write(Message(1, "b", b"[]"), role="original")
    (topic,) = LogReader(tmp_path / "log.mcap").recorded_topics()
    assert (topic.name, topic.key, topic.keyed, topic.encoding) == ("a", "a", True, "json")
    assert topic.details["riot.role"] == "delivered"


def test_injections_on_the_way_are_those_of_the_log():
    injections = [
        Injection("a", None, None, fault="delay", delay=3e-9, first=0, last=0),
        Injection("b", "v", 99.0, first=1, last=1),
        Injection("b", None, None, fault="drop", first=2, last=2),
    ]
    pipeline = Pipeline([Injector(injections)], registry=TypeRegistry(declared={"a": "json", "b": "json"}))
    merged = MergedSource([Numbers("a", 1, 3, 5), Numbers("b", 2, 4, 6)])
    found = list(PipedSource(merged, pipeline).messages())
    assert [(m.key, m.time) for m in found] == [("b", 2), ("a", 3), ("a", 4), ("b", 4), ("a", 5)]
    assert found[1].sequence == 1
    assert found[3].payload == b'{"v": 99}'


def test_reading_ahead_is_the_same_and_bounded():
    numbers = Numbers("a", *range(100_000))
    source = AheadSource(numbers)
    found = source.messages()
    assert next(found).time == 0
    deadline = time.monotonic() + 20
    former = -1
    while former != numbers.read and time.monotonic() < deadline:
        former = numbers.read
        threading.Event().wait(0.05)
    assert numbers.read < 5000
    assert [message.time for message in found] == list(range(1, 100_000))
    source.close()
    assert [message.time for message in source.messages(99_998)] == [99_998, 99_999]


def test_reading_ahead_ends_when_nobody_wants_more():
    source = AheadSource(Numbers("a", *range(100_000)))
    found = source.messages()
    next(found)
    (ahead,) = source._open
    found.close()
    ahead.thread.join(20)
    assert not ahead.thread.is_alive()
    unfinished = source.messages()
    next(unfinished)
    ahead = next(each for each in source._open if each is not ahead)
    source.close()
    assert not ahead.thread.is_alive()


def test_errors_of_reading_come_where_messages_are_wanted():
    class Broken(Numbers):
        def messages(self, start=None):
            yield from super().messages(start)
            raise OSError("the disk has gone")

    found = AheadSource(Broken("a", 1, 2)).messages()
    assert [next(found).time, next(found).time] == [1, 2]
    with pytest.raises(OSError, match="gone"):
        next(found)
