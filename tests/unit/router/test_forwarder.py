from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from riot_bus.router import forwarder as module
from riot_bus.router.forwarder import Forwarder
from tests.unit.router.fake_bus import WAIT_S, FakeBus, Recorder, eventually, sample, without_zenoh

pytestmark = pytest.mark.usefixtures("without_zenoh")
_ = without_zenoh

Forward = Callable[..., tuple[FakeBus, Forwarder]]


@pytest.fixture
def forward() -> Iterator[Forward]:
    opened: list[tuple[FakeBus, Forwarder]] = []

    def begin(*actions: Callable[[Any], object], samples: Sequence[Any] = (), **more: Any) -> tuple[FakeBus, Forwarder]:
        bus = FakeBus(*actions, samples=samples, **more)
        opened.append((bus, Forwarder("system", "cut/**", bus.deliveries, None)))
        return opened[-1]

    yield begin
    for bus, forwarder in opened:
        forwarder.close()
        bus.close()


def texts(numbers: range) -> list[bytes]:
    return [str(number).encode() for number in numbers]


def test_what_no_interceptor_wants_passes_in_order_and_is_counted(forward: Forward) -> None:
    bus, forwarder = forward(samples=[sample(text) for text in texts(range(50))])
    assert eventually(lambda: len(bus.outlet.puts) == 50)
    assert bus.outlet.payloads == texts(range(50))
    assert forwarder.passed() == forwarder.flows() == {"cut/a": 50}
    assert len(bus.outlet.declared) == 1  # only once the key has proved not to be a rare one
    assert bus.pipeline.counts["cut/a"].seen == 0


def test_after_the_end_counts_stay_and_nothing_is_left_behind(forward: Forward) -> None:
    bus, forwarder = forward(samples=[sample(text) for text in texts(range(5))])
    forwarder.close()
    assert bus.outlet.payloads == texts(range(5))
    assert forwarder.idle()
    assert forwarder.flows() == {"cut/a": 5}


def test_other_keys_than_its_own_are_left_to_others(forward: Forward) -> None:
    bus, forwarder = forward(samples=[sample(b"0", "other/a"), sample(b"1"), sample(b"2", "other/a")])
    forwarder.close()
    assert bus.outlet.payloads == [b"1"]
    assert forwarder.flows() == {"cut/a": 1}


def test_settings_of_each_message_are_kept(forward: Forward) -> None:
    rows = [
        sample(b"0"),
        sample(b"1", express=True),
        sample(b"2", encoding="text/plain"),
        sample(b"3", attachment=b"note"),
        sample(b"", kind=1),
        sample(b""),
        sample(b"4"),
    ]
    bus, forwarder = forward(samples=rows)
    forwarder.close()
    assert bus.outlet.puts == [
        (b"0", False, None, None),
        (b"1", True, None, None),
        (b"2", False, "text/plain", None),
        (b"3", False, "", b"note"),
        ("delete", False, None, None),
        (b"", False, None, None),
        (b"4", False, None, None),
    ]


def test_interceptors_change_drop_add_and_delay_in_order(forward: Forward) -> None:
    def act(event: Any) -> None:
        if event.payload == b"1":
            event.replace(b"one")
        elif event.payload == b"2":
            event.drop()

    bus, forwarder = forward(act, samples=[sample(text) for text in texts(range(4))])
    forwarder.close()
    assert bus.outlet.payloads == [b"0", b"one", b"3"]
    counts = bus.pipeline.counts["cut/a"]
    assert (counts.seen, counts.changed, counts.dropped, counts.delivered) == (4, 1, 1, 3)
    assert forwarder.passed() == {}


def test_what_is_added_comes_after_what_came_before(forward: Forward) -> None:
    def copy(event: Any) -> None:
        if event.payload == b"1":
            event.duplicate()

    bus, forwarder = forward(copy, samples=[sample(text) for text in texts(range(3))])
    forwarder.close()
    assert bus.outlet.payloads == [b"0", b"2"]
    assert [each.payload for each in bus.outlet.messages] == [b"1", b"1"]


def test_droppable_messages_beyond_the_room_are_shed_and_others_kept(
    forward: Forward, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_BACKLOG", 4)
    rows = [sample(text, congestion=1 if number in (0, 7) else 0) for number, text in enumerate(texts(range(10)))]
    bus, forwarder = forward(samples=rows)
    forwarder.close()
    assert forwarder.shed == {"cut/a": 5}
    assert bus.outlet.payloads == [b"0", b"1", b"2", b"3", b"7"]
    assert forwarder.flows() == {"cut/a": 10}


def test_keys_beyond_the_bound_are_forgotten_and_still_counted(
    forward: Forward, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_CACHED_KEYS", 3)
    _, forwarder = forward(samples=[sample(b"x", f"cut/{number % 7}") for number in range(70)])
    forwarder.close()
    assert forwarder.flows() == {f"cut/{number}": 10 for number in range(7)}


def test_of_each_batch_one_sender_is_looked_at_and_kept(forward: Forward) -> None:
    bus, forwarder = forward()
    for zid in ("a", "b", "c"):
        bus.session.channel.queue.put(sample(sender=zid))
        assert eventually(lambda: zid in forwarder.senders().get("cut/a", ()))  # noqa: B023 - called in the loop
    forwarder.forget()
    forwarder.close()
    assert forwarder.senders() == {"cut/a": {"a", "b", "c"}}


def test_what_has_changed_counts_once_it_is_told(forward: Forward) -> None:
    bus, forwarder = forward()
    bus.session.channel.queue.put(sample(b"0"))
    assert eventually(lambda: len(bus.outlet.puts) == 1)
    recorder = bus_recorder(bus)
    bus.session.channel.queue.put(sample(b"1"))
    assert eventually(lambda: len(bus.outlet.puts) == 2)
    assert recorder.rows == []  # its route was known
    forwarder.forget()
    bus.session.channel.queue.put(sample(b"2"))
    assert eventually(lambda: len(bus.outlet.puts) == 3)
    assert [row[1] for row in recorder.rows] == [b"2"]
    assert forwarder.passed() == {"cut/a": 2}
    assert forwarder.flows() == {"cut/a": 3}


def bus_recorder(bus: FakeBus) -> Any:
    recorder = Recorder()
    bus.deliveries.surround(recorder=recorder)
    return recorder


def test_a_message_that_cannot_be_published_is_lost_and_the_next_is_not(forward: Forward) -> None:
    bus, forwarder = forward(samples=[sample(b"0"), sample(b"refused"), sample(b"1")])
    forwarder.close()
    assert bus.outlet.payloads == [b"0", b"1"]
    assert bus.deliveries.losses() == {"not published": {"/cut/a": 1}}


def test_a_failure_of_ours_costs_one_message(forward: Forward, monkeypatch: pytest.MonkeyPatch) -> None:
    bus, forwarder = forward()
    monkeypatch.setattr(bus.deliveries, "feed", lambda *_: 1 / 0)
    bus.deliveries.surround(recorder=object())
    for text in (b"0", b"1"):
        bus.session.channel.queue.put(sample(text))
    forwarder.close()
    assert bus.deliveries.losses() == {"failure of ours": {"/cut/a": 2}}


def test_an_interceptor_that_blocks_is_bypassed_and_no_message_is_lost_or_repeated(forward: Forward) -> None:
    blocked, free = threading.Event(), threading.Event()

    def block(event: Any) -> None:
        if event.payload == b"1":
            blocked.set()
            free.wait(WAIT_S)

    bus, forwarder = forward(block, budget_s=0.05)
    bus.executor.start()
    for text in texts(range(4)):
        bus.session.channel.queue.put(sample(text))
    assert blocked.wait(WAIT_S)
    assert eventually(lambda: len(bus.outlet.puts) == 4)
    free.set()
    forwarder.close()
    assert bus.outlet.payloads == texts(range(4))
    assert bus.pipeline.counts["cut/a"].seen == 4
    assert bus.pipeline.counts["cut/a"].delivered == 4


def test_a_fence_opens_when_everything_before_it_is_processed(forward: Forward) -> None:
    entered, free = threading.Event(), threading.Event()

    def hold(event: Any) -> None:
        entered.set()
        free.wait(WAIT_S)

    bus, forwarder = forward(hold)
    bus.session.channel.queue.put(sample(b"0"))
    assert entered.wait(WAIT_S)
    passed = forwarder.fence()
    assert not passed()
    assert not forwarder.idle()
    free.set()
    assert eventually(lambda: passed() and len(bus.outlet.puts) == 1)
