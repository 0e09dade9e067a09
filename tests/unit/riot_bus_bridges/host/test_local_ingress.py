from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.message import Qos
from riot_bus_bridges.host.local_ingress import Inner, LocalIngress
from tests.unit.router.fake_bus import WAIT_S, FakeBus, Recorder, eventually

BLOCK = Qos(congestion="block")
Ingress = Callable[..., tuple[FakeBus, LocalIngress]]


@pytest.fixture
def ingress() -> Iterator[Ingress]:
    opened: list[tuple[FakeBus, LocalIngress]] = []

    def begin(*actions: Callable[[Any], object]) -> tuple[FakeBus, LocalIngress]:
        bus = FakeBus(*actions)
        bus.deliveries.observe("unit")  # so that messages are published, whoever listens
        opened.append((bus, LocalIngress("system", bus.deliveries, None, bus.inner)))
        return opened[-1]

    yield begin
    for bus, path in opened:
        path.close()
        bus.close()


def test_what_passes_unchanged_is_sent_at_once_when_the_key_is_known(ingress: Ingress) -> None:
    bus, path = ingress()
    key = path.declare("cut/a", BLOCK, "text/plain")
    key.put(b"0", None)
    assert eventually(path.idle)
    key.put(b"1", b"note")
    assert bus.outlet.puts == [(b"0", False, "text/plain", None), (b"1", False, "text/plain", b"note")]
    assert path.passed() == path.flows() == {"cut/a": 2}


def test_what_is_routed_natively_is_neither_sent_nor_counted(ingress: Ingress) -> None:
    bus, path = ingress()
    key = path.declare("free/a", BLOCK, "")
    key.put(b"0", None)
    assert eventually(path.idle)
    key.put(b"1", None)
    assert not path.owns("free/a")
    assert bus.outlet.puts == []
    assert path.flows() == {}


def test_interceptors_see_messages_in_order_with_all_that_belongs_to_them(ingress: Ingress) -> None:
    seen: list[tuple[bytes, str]] = []
    bus, path = ingress(lambda event: seen.append((event.payload, event.key)))
    key = path.declare("cut/a", BLOCK, "text/plain")
    for number in range(20):
        key.put(str(number).encode(), b"note")
    assert eventually(path.idle)
    assert seen == [(str(number).encode(), "cut/a") for number in range(20)]
    first = bus.outlet.messages[0]
    assert (first.encoding, first.attachment, first.qos, first.segment) == ("text/plain", b"note", BLOCK, "system")
    assert path.passed() == {}
    assert path.flows() == {"cut/a": 20}


def test_a_message_behind_queued_ones_waits_for_them(ingress: Ingress) -> None:
    entered, free = threading.Event(), threading.Event()

    def hold(event: Any) -> None:
        if event.key == "cut/slow":
            entered.set()
            free.wait(WAIT_S)

    bus, path = ingress(hold)
    slow, other = path.declare("cut/slow", BLOCK, ""), path.declare("cut/a", BLOCK, "")
    slow.put(b"0", None)
    assert entered.wait(WAIT_S)
    other.put(b"1", None)
    assert not path.idle()
    assert bus.outlet.messages == []
    free.set()
    assert eventually(path.idle)
    assert [each.payload for each in bus.outlet.messages] == [b"0", b"1"]


def test_what_is_known_of_a_key_is_asked_again_after_a_change(ingress: Ingress) -> None:
    bus, path = ingress()
    recorder = Recorder()
    key = path.declare("cut/a", BLOCK, "")
    key.put(b"0", None)
    assert eventually(path.idle)
    bus.deliveries.surround(recorder=recorder)
    key.put(b"1", None)
    path.forget()
    key.put(b"2", None)
    assert eventually(path.idle)
    assert [row[1] for row in recorder.rows] == [b"2"]


def test_a_payload_is_rewritten_on_the_thread_that_puts_it_and_counted(ingress: Ingress) -> None:
    class Rewriting:
        def message(self, event: Any) -> None:
            event.replace(b"slow way")

        def rewriter(self, kind: object, key: str, payload: bytes) -> Callable[[bytes], bytes]:
            return lambda payload: bytes(reversed(payload)) if payload != b"bad" else 1 / 0  # type: ignore[return-value]

    bus, path = ingress()
    bus.executor.replace([Rewriting()])
    key = path.declare("cut/a", BLOCK, "")
    key.put(b"01", None)
    assert eventually(path.idle)
    key.put(b"23", None)
    assert bus.outlet.payloads == [b"10", b"32"]
    key.put(b"bad", None)  # what the function cannot do, the interceptor does
    assert eventually(path.idle)
    assert [each.payload for each in bus.outlet.messages] == [b"slow way"]
    assert path.passed() == {}
    assert bus.pipeline.counts["cut/a"].changed == 3


def test_bridges_in_this_process_get_batches_and_others_single_messages(ingress: Ingress) -> None:
    bus, path = ingress()
    taken: list[Any] = []
    inner = Inner(SimpleNamespace(includes=lambda key: key == "cut/a"), taken.append)  # type: ignore[arg-type]
    bus.deliveries.surround(observed=frozenset())
    bus.inner["unit"] = (inner,)
    key = path.declare("cut/a", BLOCK, "")
    key.audiences["unit"] = SimpleNamespace(put=lambda *row: None, close=lambda: None)  # type: ignore[assignment]
    key.put(b"0", None)
    assert eventually(path.idle)
    path.put_all([key, key], [b"1", b"2"], b"n")
    assert taken == [[(b"0", None)], [(b"1", b"n"), (b"2", b"n")]]


def test_a_message_that_cannot_be_sent_is_lost_and_the_next_is_not(ingress: Ingress) -> None:
    bus, path = ingress()
    key = path.declare("cut/a", BLOCK, "")
    for text in (b"0", b"refused", b"1"):
        key.put(text, None)
    assert eventually(path.idle)
    assert bus.outlet.payloads == [b"0", b"1"]
    assert bus.deliveries.losses() == {"not published": {"/cut/a": 1}}


def test_counts_of_a_key_that_is_closed_stay(ingress: Ingress) -> None:
    _, path = ingress()
    key = path.declare("cut/a", BLOCK, "")
    key.put(b"0", None)
    assert eventually(path.idle)
    key.close()
    key.close()
    assert path.flows() == {"cut/a": 1}
