from __future__ import annotations

import threading

from riot_bus.pipeline.mailbox import Dispatcher, Mailbox
from riot_bus.vocabulary.message import Message


def test_order_is_kept_and_size_is_bounded() -> None:
    box: Mailbox[int] = Mailbox(capacity=2)
    assert [box.offer(number, 0) for number in range(3)] == [True, True, False]
    assert (len(box), box.accepted) == (2, 2)
    assert [box.take(0), box.take(0), box.take(0)] == [0, 1, None]


def test_bytes_are_bounded_but_one_large_item_always_fits() -> None:
    box: Mailbox[str] = Mailbox(capacity_bytes=1000)
    assert box.offer("large", 5000)
    assert not box.offer("small", 1)
    assert box.take() == "large"
    assert box.offer("small", 1)


def test_many_are_taken_at_once_in_order_but_not_more_than_a_handful_of_bytes() -> None:
    box: Mailbox[int] = Mailbox()
    for number in range(10):
        assert box.offer(number, 0)
    assert box.take_many(4, 0) == [0, 1, 2, 3]
    box.wake()
    assert box.offer(10, 0)
    assert [box.take_many(100, 0) for _ in range(3)] == [[4, 5, 6, 7, 8, 9], [10], []]
    for number in range(8):
        assert box.offer(number, 1 << 20)
    assert box.take_many(100, 0) == [0, 1, 2, 3]
    assert len(box) == 4


def test_who_lingers_takes_what_comes_meanwhile() -> None:
    box: Mailbox[int] = Mailbox()
    taken: list[list[int]] = []
    first = threading.Thread(target=lambda: taken.append(box.take_many(100, 10, linger_s=0.5)))
    first.start()
    for number in range(5):
        assert box.offer(number, 0)
    first.join()
    assert taken == [[0, 1, 2, 3, 4]]


def test_nothing_is_forgotten_between_many_who_put_and_one_who_takes() -> None:
    box: Mailbox[tuple[int, int]] = Mailbox()
    putters = [
        threading.Thread(target=lambda name=name: [box.offer((name, number), 0) for number in range(5000)])  # type: ignore[misc]
        for name in range(4)
    ]
    for each in putters:
        each.start()
    found: list[tuple[int, int]] = []
    while len(found) < 20_000:
        some = box.take_many(256, 10, linger_s=0.001)
        assert some, len(found)
        found += some
    for name in range(4):
        assert [number for who, number in found if who == name] == list(range(5000))
    assert (len(box), box.take(0)) == (0, None)


def test_wake_ends_a_wait() -> None:
    box: Mailbox[int] = Mailbox()
    box.wake()
    assert box.take() is None


def test_dispatcher_survives_callbacks_that_raise_and_counts_what_does_not_fit() -> None:
    lost: list[bytes] = []
    seen: list[bytes] = []
    dispatcher = Dispatcher("test", lambda message: lost.append(message.payload), mailbox=Mailbox(capacity=2))

    def callback(message: Message) -> None:
        if message.payload == b"bad":
            raise RuntimeError("on purpose")
        seen.append(message.payload)

    for payload in (b"bad", b"good", b"too many"):
        dispatcher.deliver(callback, Message(0, "k", payload))
    dispatcher.start()
    dispatcher.close()
    dispatcher.close()
    assert (seen, lost, dispatcher.failures, dispatcher.idle()) == ([b"good"], [b"too many"], 1, True)
