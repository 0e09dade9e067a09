from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from riot_bus.log.account import Account, LossCounts
from riot_bus.log.gaps import Gaps
from riot_bus.log.layout import Constants
from riot_bus.log.log_channels import ChannelWriter
from riot_bus.record.subscriber import KeyRules, RecordingSubscriber
from riot_bus.types.capabilities import Stamp


class Payload(bytes):
    def to_bytes(self) -> bytes:
        return bytes(self)


ONE = Payload(b"1")


@dataclass(frozen=True)
class Time:
    """A Zenoh timestamp: nanoseconds, and the id of the session that gave it."""

    number: int
    zid: str = "z"

    def get_time_as_ntp64(self) -> SimpleNamespace:
        return SimpleNamespace(as_nanos=lambda: self.number)

    def get_id(self) -> str:
        return self.zid

    def __ge__(self, other: Time) -> bool:
        return self.number >= other.number


@dataclass(frozen=True)
class Sample:
    payload: Payload = ONE
    key_expr: str = "a/x"
    encoding: str = "zenoh/bytes"
    priority: int = 5
    congestion_control: int = 1
    express: bool = False
    attachment: Payload | None = None
    timestamp: Time | None = None
    source_info: Any = None
    kind: int = 0


class FakeBatches:
    """A subscription that hands out lists of samples, and raises those that are errors."""

    def __init__(self) -> None:
        self.given: queue.Queue[list[Any]] = queue.Queue()

    def receive(self) -> list[Any]:
        return self.given.get(timeout=10)

    def close(self) -> None:
        self.given.put([])


class FakeSink:
    def __init__(self, *, room: bool = True) -> None:
        self.lock, self.generation, self.counts = threading.RLock(), 0, LossCounts()
        self.rows: list[Any] = []
        self.patient: list[bool] = []
        self.writer = SimpleNamespace(track=self.track)
        self.room = room

    def track(self, message: Any) -> ChannelWriter | None:
        return ChannelWriter(1, Constants.of(message)) if self.room else None

    def append(self, rows: Sequence[Any], *, patient: bool) -> None:
        self.rows += rows
        self.patient.append(patient)


class Bench:
    """A subscriber between fakes."""

    def __init__(self, rules: Callable[[str], KeyRules | None], sink: FakeSink) -> None:
        self.batches, self.sink, self.gaps = FakeBatches(), sink, Gaps()
        self.paused = False
        self.subscriber = RecordingSubscriber(
            self.batches,  # type: ignore[arg-type]
            "a/**",
            sink=sink,  # type: ignore[arg-type]
            gaps=self.gaps,
            owner=lambda key: "a/**",
            rules=rules,
            paused=lambda: self.paused,
            sequence=itertools.count(100),
        )

    def send(self, *samples: Any) -> None:
        self.batches.given.put(list(samples))

    def rows(self) -> list[Any]:
        self.subscriber.close()
        return self.sink.rows

    def account(self) -> Account:
        self.subscriber.close()
        return self.sink.counts.account()


@contextmanager
def bench(rules: Callable[[str], KeyRules | None] = KeyRules, *, room: bool = True) -> Iterator[Bench]:
    found = Bench(rules, FakeSink(room=room))
    yield found
    found.subscriber.close()


def test_a_message_becomes_a_row() -> None:
    with bench() as b:
        b.send(Sample(), Sample(Payload(b"22")))
        first, second = b.rows()
    number, sequence, now, published, payload, extras = first
    assert (number, sequence, payload, extras) == (1, 100, b"1", None)
    assert now == published > 0
    assert second[1:5:3] == (101, b"22")
    assert b.account() == Account({"a/x": 2})
    assert b.subscriber.flows == {"a/x": 2}


def test_what_is_not_to_be_recorded_leaves_no_trace() -> None:
    with bench(lambda key: None) as b:
        b.send(Sample())
        assert b.rows() == []
    assert b.account() == Account()


def test_what_differs_from_the_first_message_is_an_extra() -> None:
    with bench() as b:
        b.send(Sample(), Sample(encoding="application/json"), Sample(priority=1), Sample(kind=1, payload=Payload(b"")))
        extras = [row[5] for row in b.rows()]
    assert extras == [None, {"e": "application/json"}, {"q": [1, "block", False]}, {"d": True}]


def test_only_droppable_messages_do_not_wait_for_the_disk() -> None:
    for congestion, patient in ((0, False), (1, True)):
        with bench() as b:
            b.send(Sample(congestion_control=congestion))
            b.rows()
        assert b.sink.patient == [patient]


def test_the_publisher_says_number_and_time() -> None:
    def rules(key: str) -> KeyRules:
        return KeyRules(key, stamp=lambda data: Stamp(data[0], 10**9 * data[0], "p"))

    with bench(rules) as b:
        b.send(*(Sample(attachment=Payload(bytes([number]))) for number in (1, 2, 5)))
        rows = b.rows()
    assert [(row[1], row[3], row[5]) for row in rows] == [(n, n * 10**9, {"a": bytes([n])}) for n in (1, 2, 5)]
    assert b.account() == Account({"a/x": 3}, {"missed": {"a/x": 2}})


def test_source_info_gives_numbers_too() -> None:
    source = SimpleNamespace(zid="z", eid=1)
    with bench() as b:
        b.send(*(Sample(source_info=SimpleNamespace(source_id=source, source_sn=n)) for n in (7, 9, 2**32 + 1)))
        rows = b.rows()
    assert [row[1] for row in rows] == [7, 9, 1]
    assert rows[2][5] == {"n": 2**32 + 1}
    assert b.account().lost["missed"]["a/x"] == 1 + 2**32 - 9


def test_times_that_the_file_cannot_hold_are_extras() -> None:
    with bench() as b:
        b.send(Sample(timestamp=Time(5)), Sample(timestamp=Time(2**64)))
        first, second = b.rows()
    assert (first[3], first[5]) == (5, None)
    assert (second[3], second[5]) == (second[2], {"p": str(2**64)})


def test_what_was_fetched_from_a_cache_is_recorded_once() -> None:
    with bench() as b:
        old = [Sample(Payload(bytes([n])), timestamp=Time(n)) for n in (1, 2)]
        b.subscriber.put(old)
        b.subscriber.put(old)
        b.send(old[1], Sample(Payload(b"\3"), timestamp=Time(3)))
        b.subscriber.close()
        b.subscriber.put([replace(old[0], timestamp=Time(9)), Sample()])
        assert [row[4] for row in b.rows()] == [b"\1", b"\2", b"\3"]


def test_pausing_and_throttling_leave_out_and_the_trigger_sees_all() -> None:
    seen: list[bytes] = []
    with bench(lambda key: KeyRules(key, least_ns=10**12, trigger=lambda data, key: seen.append(data))) as b:
        b.paused = True
        b.send(Sample(Payload(b"1")))
        b.subscriber.close()
        b.paused = False
        rows, _ = b.subscriber._rows([Sample(Payload(b"2")), Sample(Payload(b"3"))])
    assert [row[4] for row in rows] == [b"2"]
    assert seen == [b"1", b"2", b"3"]
    assert b.account().left_out == {"paused": {"a/x": 1}, "throttled": {"a/x": 1}}


def test_a_key_without_room_in_the_file_is_refused() -> None:
    with bench(room=False) as b:
        b.send(Sample())
        assert b.rows() == []
    assert b.account() == Account(lost={"refused": {"a/x": 1}})


def test_a_message_that_cannot_be_read_is_the_only_one_lost() -> None:
    with bench() as b:
        b.send(Sample(), Sample(source_info=SimpleNamespace()), Sample(Payload(b"3")))
        assert [row[4] for row in b.rows()][-1] == b"3"
    assert b.account().lost == {"damaged": {"a/**": 1}}


def test_another_file_needs_another_track() -> None:
    with bench() as b:
        b.send(Sample())
        b.subscriber.close()
        b.sink.generation, b.sink.room = 1, False
        b.subscriber._slice([Sample()])
    assert b.account() == Account({"a/x": 1}, {"refused": {"a/x": 1}})


def test_senders_are_those_in_the_stamps() -> None:
    with bench() as b:
        b.send(Sample(timestamp=Time(1, "z1")))
        b.send(Sample(timestamp=Time(2, "z2")))
        b.subscriber.close()
        assert b.subscriber.senders() == {"a/x": {"z1", "z2"}}
