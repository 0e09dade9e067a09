from __future__ import annotations

import queue
import threading
from collections import deque
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.router.byte_gate import LARGE, ByteBudget, ByteGate

KIB = 1 << 10
SIZES = st.integers(LARGE, 5 * LARGE)


class ClosedError(Exception):
    pass


class Channel:
    """As Zenoh's, without its limit, since that alone would hold up senders."""

    def __init__(self) -> None:
        self.queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def try_recv(self) -> Any:
        try:
            return self._opened(self.queue.get_nowait())
        except queue.Empty:
            return None

    def recv(self) -> Any:
        return self._opened(self.queue.get(timeout=60))

    def close(self) -> None:
        """Let whoever has received all the rest be told so from then on."""
        self.queue.put(ClosedError)

    def _opened(self, sample: Any) -> Any:
        if sample is ClosedError:
            self.close()
            raise ClosedError
        return sample


def message(size: int, name: object = None, *, droppable: bool = False) -> Any:
    return SimpleNamespace(payload=range(size), name=name, congestion_control=0 if droppable else 1)


class Gate(ByteGate):
    """Tells how much came while the forwarder woke up, for which nobody waits."""

    uncounted = 0

    def admit(self, sample: Any) -> None:
        with self._budget.changed:
            if self._receiving:
                self.uncounted += len(sample.payload)
            super().admit(sample)


class Topic:
    """A gate, its channel, and what came out of it."""

    def __init__(self, budget: ByteBudget, *, before: bool = True) -> None:
        self.channel = Channel()
        self.dropped: list[Any] = []
        self.gate = Gate(budget, self.channel, closed=ClosedError, drop=self.dropped.append)
        self.gate.active = True
        self.before = before
        self.forwarded: list[Any] = []

    def send(self, sample: Any) -> None:
        """Do as Zenoh does, which calls subscribers in any order."""
        if self.before:
            self.gate.admit(sample)
        self.channel.queue.put(sample)
        if not self.before:
            self.gate.admit(sample)

    def forward(self) -> None:
        self.forwarded += self.gate.receive()


@settings(deadline=None, max_examples=60)
@given(
    topics=st.lists(st.lists(st.lists(SIZES, max_size=12), min_size=1, max_size=3), min_size=1, max_size=3),
    size=st.integers(1, 20 * LARGE),
    before=st.booleans(),
)
def test_any_senders_keep_to_the_budget_and_their_order_and_none_waits_for_ever(
    topics: list[list[list[int]]], size: int, before: bool
) -> None:
    """However small the budget and however large a message: the rest is one message of each sender."""
    budget = ByteBudget(size)
    spare = sum(max(sizes, default=0) for senders in topics for sizes in senders)
    gates, most = [Topic(budget, before=before) for _ in topics], [0]

    def send(topic: Topic, number: int, sizes: list[int]) -> None:
        for place, each in enumerate(sizes):
            topic.send(message(each, (number, place)))

    def forward(topic: Topic) -> None:
        with suppress(ClosedError):
            while True:  # what it has forwarded is free only when it asks for more
                topic.forward()
                with budget.changed:
                    most.append(sum(each.gate.held for each in gates))

    def ended(threads: list[threading.Thread]) -> bool:
        for each in threads:
            each.join(60)
        return not any(each.is_alive() for each in threads)

    forwarders = [threading.Thread(target=forward, args=(topic,)) for topic in gates]
    threads = [
        threading.Thread(target=send, args=(topic, *each))
        for topic, senders in zip(gates, topics, strict=True)
        for each in enumerate(senders)
    ]
    for each in (*forwarders, *threads):
        each.start()
    assert ended(threads)
    for topic in gates:
        topic.channel.close()
    assert ended(forwarders)
    for topic, senders in zip(gates, topics, strict=True):
        for number, sizes in enumerate(senders):
            names = [sample.name for sample in topic.forwarded if sample.name[0] == number]
            assert names == [(number, place) for place in range(len(sizes))]
    assert max(most) <= size + spare + sum(topic.gate.uncounted for topic in gates)


def test_a_topic_that_is_not_forwarded_takes_half_and_leaves_room_for_others() -> None:
    budget = ByteBudget(16 * LARGE)
    stuck, free = Topic(budget), Topic(budget)
    sender = threading.Thread(target=lambda: deque(map(stuck.send, (message(LARGE) for _ in range(100)))))
    sender.start()
    for number in range(100):
        free.send(message(LARGE, number))
        free.forward()
    assert [each.name for each in free.forwarded] == list(range(100))
    assert sender.is_alive()
    assert stuck.gate.held <= 8 * LARGE
    stuck.gate.end()
    sender.join(60)
    assert not sender.is_alive()


def test_droppable_messages_without_room_are_dropped_and_no_sender_waits_for_them() -> None:
    topic = Topic(ByteBudget(16 * LARGE))
    for number in range(100):
        topic.send(message(LARGE, number, droppable=True))
    while len(topic.forwarded) + len(topic.dropped) < 100:
        topic.forward()
    assert [each.name for each in topic.forwarded[:8]] == list(range(8))
    assert sorted(each.name for each in [*topic.forwarded, *topic.dropped]) == list(range(100))


def test_a_message_counts_for_the_receive_buffer_that_it_keeps() -> None:
    topic = Topic(ByteBudget())
    for _ in range(3):
        topic.send(message(8, droppable=True))
    topic.gate.admit(message(8, droppable=True))
    assert topic.gate.held == 3 * 64 * KIB


def test_many_small_messages_at_once_are_no_longer_counted_and_all_handed_out() -> None:
    budget = ByteBudget()
    topic = Topic(budget)
    total = budget.free
    topic.send(message(LARGE + 1))
    topic.forward()
    for _ in range(128):
        topic.send(message(8))
    topic.forward()
    while topic.gate.active:  # it took longer than such a flood may
        for _ in range(128):
            topic.send(message(8))
        topic.forward()
    assert (topic.gate.held, len(topic.gate.waiting), budget.free) == (0, 0, total)


def test_a_closed_channel_ends_the_receiver_when_nothing_waits() -> None:
    topic = Topic(ByteBudget())
    topic.send(message(LARGE))
    topic.forward()
    topic.channel.close()
    try:
        topic.forward()
    except ClosedError:
        assert topic.gate.held == 0
    else:
        raise AssertionError("the receiver waits for a closed channel")
