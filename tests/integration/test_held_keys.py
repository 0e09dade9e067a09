"""What is on its way to a router's own session arrives there whatever the session declares meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh

from riot_bus.router.bus import Bus
from riot_bus.zenoh import keyexpr_pins as held_keys
from riot_bus.zenoh.attachment_probe import AttachmentProbe
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import release, wait_until
from tests.integration.advanced_tools import KEY, WAIT_S, Prefix, changed, component, running
from tests.integration.fault_tools import assert_balanced, received, subscribed

pytestmark = pytest.mark.integration


@contextmanager
def meanwhile(do: Callable[[], object]) -> Iterator[None]:
    """Do something again and again on another thread."""
    end = threading.Event()
    failures: list[Exception] = []

    def run() -> None:
        while not end.is_set() and not failures:
            try:
                do()
            except Exception as error:
                failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
    assert not failures


def ear(bus: Bus) -> None:
    AttachmentProbe(KEY, [bus.segment("unit").session], lambda: None).close()


@pytest.mark.parametrize("intercepted", ["cut/**", "**"])
@pytest.mark.parametrize("do", [lambda bus: subscribed(bus, "unit", KEY), ear], ids=["asks", "hears"])
def test_messages_pass_while_the_router_asks_who_has_subscribed_or_hears_a_type(
    do: Callable[[Bus], None], intercepted: str
) -> None:
    """Zenoh 1.10.2 throws away what is on its way to a session while that takes back the number of a key."""
    count = 20_000
    with running(Prefix(), intercept=[intercepted]) as (bus, join):
        source, sink = join("unit"), join("system")
        taken = threading.Semaphore(0)
        _subscribers = [
            sink.declare_subscriber(KEY, lambda _: taken.release()),
            source.declare_subscriber(KEY, lambda _: None),
        ]
        subscribed(bus, "system", KEY)
        publisher = source.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
        with meanwhile(lambda: do(bus)):
            for _ in range(count):
                publisher.put("text")
            for _ in range(count):
                assert taken.acquire(timeout=WAIT_S), received(bus, KEY)
        assert wait_until(lambda: received(bus, KEY) == count, WAIT_S)
        assert_balanced(bus)


@pytest.mark.parametrize("expression", ["a/b", "a/**", "**"])
def test_questions_end_while_a_session_declares_and_undeclares(expression: str) -> None:
    with Network({"only": ()}) as network:
        session = network.segments["only"].session
        library = library_of(session)
        answer = library.handlers.Callback(lambda query: query.drop(), indirect=False)
        pin(session, expression)
        _queryable = session.declare_queryable(expression, answer)
        asking = component(network.segments["only"].endpoints[0])

        def declare() -> None:
            pin(session, expression)
            release(session.declare_publisher(expression))

        try:
            with meanwhile(declare):
                for _ in range(2000):
                    assert [reply.err for reply in asking.get(expression, timeout=WAIT_S)] == []
        finally:
            release(asking)


@pytest.mark.parametrize("looked_at", [True, False])
def test_keys_get_a_number_while_their_messages_are_on_the_way(
    monkeypatch: pytest.MonkeyPatch, *, looked_at: bool
) -> None:
    """Of which none is lost, none comes twice, and those of a key keep their order."""
    monkeypatch.setattr(held_keys, "_OFTEN", 1)
    keys, count = [f"cut/{number}" for number in range(20)], 1000
    with running(*([Prefix()] if looked_at else [])) as (bus, join):
        source, sink = join("unit"), join("system")
        taken: dict[str, list[str]] = {key: [] for key in keys}
        arrived = threading.Semaphore(0)

        def take(sample: zenoh.Sample) -> None:
            taken[str(sample.key_expr)].append(sample.payload.to_string())
            arrived.release()

        _subscriber = sink.declare_subscriber("cut/*", take)
        subscribed(bus, "system", "cut/*")
        numbered = held_keys._frequent[id(bus.segment("unit").session)]
        for key in keys:
            assert key not in numbered
        for number in range(count):
            for key in keys:
                source.put(key, str(number), congestion_control=zenoh.CongestionControl.BLOCK)
        for _ in range(count * len(keys)):
            assert arrived.acquire(timeout=WAIT_S)
        assert len(set(numbered) & set(keys)) > 1
        expected = [str(number) for number in range(count)]
        for key in keys:
            assert taken[key] == (changed(expected) if looked_at else expected)
        assert_balanced(bus)


def test_messages_of_all_kinds_on_one_key_keep_their_order() -> None:
    """Some have an attachment, another encoding, no payload or are deletes; nobody looks at them."""
    count = 3000
    with running() as (bus, join):
        source, sink = join("unit"), join("system")
        taken: list[tuple[str, str, bool]] = []
        arrived = threading.Semaphore(0)

        def take(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            kind = "delete" if int(sample.kind) else str(sample.encoding)  # type: ignore[call-overload]
            taken.append((sample.payload.to_string(), kind, attachment is not None))
            arrived.release()

        _subscriber = sink.declare_subscriber(KEY, take)
        subscribed(bus, "system", KEY)
        publisher = source.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
        expected = []
        for number in range(count):
            text, encoding, attachment = str(number), "zenoh/bytes", None
            match number % 11:
                case 3:
                    attachment = b"more"
                case 5:
                    encoding = "text/plain"
                case 7:
                    text = ""
            if number % 11 == 9:
                publisher.delete()
                expected.append(("", "delete", False))
                continue
            publisher.put(text, encoding=encoding, attachment=attachment)
            expected.append((text, encoding, attachment is not None))
        for _ in range(count):
            assert arrived.acquire(timeout=WAIT_S)
        assert taken == expected
        assert wait_until(lambda: received(bus, KEY) == count, WAIT_S)
        assert_balanced(bus)
