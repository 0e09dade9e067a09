from __future__ import annotations

import threading
import time

from riot_bus.bus.mailbox import Dispatcher, Mailbox
from riot_bus.message import Message


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


def test_patience_is_spent_once_until_the_box_has_drained() -> None:
    box: Mailbox[int] = Mailbox(capacity=2, patience_s=0.05)
    assert box.offer(0, 0)
    assert box.offer(1, 0)
    assert not box.offer(2, 0, patient=True)
    began = time.monotonic()
    assert not any(box.offer(3, 0, patient=True) for _ in range(100))
    assert time.monotonic() - began < 1
    assert box.take() == 0
    assert box.offer(4, 0, patient=True)


def test_patient_offer_gets_room_that_comes() -> None:
    box: Mailbox[int] = Mailbox(capacity=1, patience_s=10)
    assert box.offer(0, 0)
    taker = threading.Timer(0.01, box.take)
    taker.start()
    assert box.offer(1, 0, patient=True)
    taker.join()


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
