"""What is on its way to a router's own session arrives there whatever the session declares meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh

from riot_bus.bus.ear import Ear
from riot_bus.bus.held_keys import hold
from riot_bus.bus.libraries import library_of
from riot_bus.bus.network import Network
from riot_bus.bus.router import Bus
from riot_bus.bus.runtime import release, wait_until
from tests.integration.advanced_tools import KEY, WAIT_S, Prefix, component, running
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
    Ear(KEY, [bus.segment("unit").session], lambda: None).close()


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
        hold(session, expression)
        _queryable = session.declare_queryable(expression, answer)
        asking = component(network.segments["only"].endpoints[0])

        def declare() -> None:
            hold(session, expression)
            release(session.declare_publisher(expression))

        try:
            with meanwhile(declare):
                for _ in range(2000):
                    assert [reply.err for reply in asking.get(expression, timeout=WAIT_S)] == []
        finally:
            release(asking)
