"""The way through the pipeline for what this process puts itself, on a real bus."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.event import Event
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from riot_bus_bridges.host.inner import InnerPort
from riot_bus_bridges.host.local_ingress import InnerNetwork
from tests.integration.fault_tools import subscribed

pytestmark = pytest.mark.integration

WAIT_S = 60.0
KEY = "a/b"
SEGMENTS = {"one": ["tcp/127.0.0.1:0"], "two": ["tcp/127.0.0.1:0"]}


class Looker:
    """Wants to see all, or some topics only."""

    def __init__(self, topics: list[str] | None = None) -> None:
        self.topics = topics
        self.indices: list[int] = []

    def message(self, event: Event) -> None:
        self.indices.append(event.index)


@pytest.fixture
def bus() -> Iterator[Bus]:
    registry = TypeRegistry(declared={KEY: "json"})
    with Bus(SEGMENTS, intercept=["a/**"], registry=registry) as opened:
        yield opened


def test_order_is_kept_while_interceptors_come_and_go(bus: Bus) -> None:
    network = InnerNetwork(bus)
    one, two = InnerPort(network, "one"), InnerPort(network, "two")
    got: list[tuple[bytes, bytes | None]] = []
    two.collect("a/*", got.extend)
    outlet = one.publisher(KEY, reliable=True)
    assert outlet.matched()
    ended = threading.Event()
    looker = Looker()

    def change() -> None:
        turns: list[list[object]] = [[], [looker]]
        number = 0
        while not ended.is_set():
            number += 1
            bus.set_interceptors(turns[number % 2])

    changing = threading.Thread(target=change)
    changing.start()
    try:
        for number in range(5000):
            outlet.put(b"%d" % number, b"x")
    finally:
        ended.set()
        changing.join()
    assert bus.drain(WAIT_S)
    assert got == [(b"%d" % number, b"x") for number in range(5000)]
    counts = bus.counts()[KEY]
    assert (counts.received, counts.forwarded, counts.lost, counts.held) == (5000, 5000, 0, 0)
    assert bus.flows()[KEY, "one"] == 5000
    assert looker.indices == sorted(looker.indices)


def test_counts_and_hits_of_what_is_rewritten_are_those_of_a_look(bus: Bus) -> None:
    network = InnerNetwork(bus)
    one, two = InnerPort(network, "one"), InnerPort(network, "two")
    got: list[bytes] = []
    two.subscribe("a/*", lambda payload, attachment: got.append(payload))
    injector = Injector([Injection(KEY, "x", 7)])
    bus.set_interceptors([injector])
    outlet = one.publisher(KEY, reliable=True)
    for number in range(100):
        outlet.put(b'{"x":%d,"y":1}' % number, b"")
    outlet.put(b'{"y":1}', b"")
    assert bus.drain(WAIT_S)
    assert got == [b'{"x":7,"y":1}'] * 100 + [b'{"y":1}']
    outlet.close()
    counts = bus.counts()[KEY]
    assert (counts.received, counts.changed, counts.forwarded) == (101, 100, 101)
    assert injector.hits[0] == 100
    assert sum(injector.skipped.values()) == 1


def test_many_at_once_go_as_one_by_one(bus: Bus) -> None:
    network = InnerNetwork(bus)
    one, two = InnerPort(network, "one"), InnerPort(network, "two")
    got: list[tuple[bytes, bytes | None]] = []
    seen: list[bytes] = []
    two.collect("**", got.extend)
    looker = Looker(["a/seen"])
    bus.set_interceptors([looker, Injector([Injection(KEY, "x", -1)])])
    with open_client(bus.endpoint("two")) as client:
        client.subscribe("a/**", lambda message: seen.append(message.payload))
        outlets = [one.publisher(key, reliable=True) for key in (KEY, "a/passes", "a/seen", "native")]
        assert wait_until(lambda: all(outlet.matched() for outlet in outlets), WAIT_S)
        subscribed(bus, "two", KEY)  # the client as well, of which an outlet that is matched says nothing
        payloads = [b'{"x":%d}' % number for number in range(400)]
        used = [outlets[number % 4] for number in range(400)]
        for at in range(0, 400, 40):
            assert one.put_all(used[at : at + 40], payloads[at : at + 40], b"@") == 0
        assert bus.drain(WAIT_S)
        assert wait_until(lambda: len(got) == 400 and len(seen) == 300, WAIT_S)
    for number in range(4):
        expected = [b'{"x":-1}'] * 100 if number == 0 else payloads[number::4]
        mine = [payload for payload, _ in got if payload in set(expected)]
        assert mine == expected
        if number < 3:
            assert [payload for payload in seen if payload in set(expected)] == expected
    assert {attachment for _, attachment in got} == {b"@"}
    assert looker.indices == list(range(100))
    counts = bus.counts()
    for key, changed in ((KEY, 100), ("a/passes", 0), ("a/seen", 0)):
        each = counts[key]
        assert (each.received, each.changed, each.forwarded, each.lost) == (100, changed, 100, 0)


def test_everybody_hears_once_what_others_put(bus: Bus) -> None:
    network = InnerNetwork(bus)
    one, two = InnerPort(network, "one"), InnerPort(network, "two")
    got: dict[str, list[bytes]] = {"one": [], "two": [], "observer": []}
    one.subscribe("**", lambda payload, attachment: got["one"].append(payload))
    two.subscribe("**", lambda payload, attachment: got["two"].append(payload))
    bus.subscribe("two", "**", lambda message: got["observer"].append(message.payload))
    outlets = [one.publisher(key, reliable=True) for key in (KEY, "native")]
    assert wait_until(lambda: all(outlet.matched() for outlet in outlets), WAIT_S)
    for outlet in outlets:
        outlet.put(b"inner", b"")
    assert wait_until(lambda: len(got["two"]) == len(got["observer"]) == 2, WAIT_S)
    with open_client(bus.endpoint("two")) as client:
        for key in (KEY, "native"):
            client.put(Message(0, key, b"outer"))
        assert wait_until(lambda: len(got["one"]) == 2 and len(got["two"]) == len(got["observer"]) == 4, WAIT_S)
    assert bus.drain(WAIT_S)
    assert got == {"one": [b"outer"] * 2, "two": [b"inner"] * 2 + [b"outer"] * 2, "observer": got["two"]}


def test_who_has_gone_hears_no_more(bus: Bus) -> None:
    network = InnerNetwork(bus)
    one, two = InnerPort(network, "one"), InnerPort(network, "two")
    got: list[bytes] = []
    listening = two.subscribe("a/*", lambda payload, attachment: got.append(payload))
    outlet = one.publisher(KEY, reliable=False)
    outlet.put(b"1", b"")
    assert bus.drain(WAIT_S)
    listening.close()
    outlet.put(b"2", b"")
    assert bus.drain(WAIT_S)
    assert got == [b"1"]
