"""What interceptors can do to the router: raise, hang, or make rubbish of a message."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import pytest

from riot_bus.pipeline.event import Event
from riot_bus.router.bus import Bus
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import SEGMENTS, assert_balanced, everything, payloads, pipeline, subscribed

pytestmark = pytest.mark.integration


class UnprintableError(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no text either")

    __repr__ = __str__


def raises(error: BaseException) -> Callable[[Any], None]:
    def act(event: Any) -> None:
        raise error

    return act


def sets(name: str, value: Any) -> Callable[[Any], None]:
    return lambda event: setattr(event, name, value)


def recurse(event: Any) -> None:
    recurse(event)


def changed(**change: Any) -> Callable[[Any], None]:
    """Replace the message by one that nobody can publish."""
    return lambda event: setattr(event, "message", event.message.with_(**change))


def added(**change: Any) -> Callable[[Any], None]:
    return lambda event: event.add(event.message.with_(**change))


def many(event: Any) -> None:
    for _ in range(100_000):
        event.add(event.message)


RUBBISH: dict[str, Callable[[Any], object]] = {
    "raise": raises(RuntimeError("on purpose")),
    "raise unprintable": raises(UnprintableError()),
    "raise in a circle": recurse,
    "exit": raises(SystemExit(1)),
    "interrupt": raises(KeyboardInterrupt()),
    "cancel": raises(asyncio.CancelledError()),
    "generator exit": raises(GeneratorExit()),
    "no message": sets("message", None),
    "text as message": sets("message", "text"),
    "no payload": changed(payload=None),
    "text as payload": changed(payload="text"),
    "buffer as payload": changed(payload=bytearray(b"text")),
    "replace by nothing": lambda event: event.replace(None),
    "empty key": changed(key=""),
    "wild key": changed(key="cut/**"),
    "double slash": changed(key="cut//x"),
    "question": changed(key="cut/x?a=b"),
    "number as key": changed(key=7),
    "surrogate as key": changed(key="cut/\ud800"),
    "text as attachment": changed(attachment="text"),
    "number as encoding": changed(encoding=3),
    "surrogate as encoding": changed(encoding="text;\ud800"),
    "unknown kind": changed(kind="patch"),
    "unknown priority": changed(qos=Qos(99)),
    "no delivery": changed(qos=None),
    "add nothing": lambda event: event.add(None),
    "add to a hostile key": added(key="/**/"),
    "add without payload": added(payload=None),
    "add a hundred thousand": many,
    "delay by nan": lambda event: event.delay(float("nan")),
    "delay for ever": lambda event: event.delay(float("inf")),
    "delay by text": lambda event: event.delay("soon"),
    "fraction as delay": sets("delay_ns", 0.5),
    "a milliard copies": lambda event: event.duplicate(10**9),
    "a milliard copies, set": sets("copies", 10**9),
    "text as copies": sets("copies", "2"),
    "nothing as added": sets("added", None),
    "rubbish as added": sets("added", [None]),
    "number as added": sets("added", 5),
    "nothing as changes": sets("changes", None),
    "number as changes": sets("changes", 5),
    "nothing as targets": sets("targets", None),
    "unknown target": sets("targets", ("nowhere",)),
    "rubbish as branches": sets("branches", [None]),
}


class Rubbish:
    """Does to a message what its text says, after it has changed it properly."""

    def message(self, event: Event) -> None:
        act = RUBBISH.get(event.payload.decode())
        if act is not None:
            event.replace(b"half done")
            act(event)


@pytest.mark.parametrize("recorded", [False, True], ids=["", "recorded"])
def test_a_message_of_which_an_interceptor_makes_rubbish_goes_on_as_it_was(recorded: bool) -> None:
    interceptors = pipeline(Rubbish())
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=interceptors, budget_s=60) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        interceptors.provenance = recorded
        sink.do("subscribe", key="**")
        subscribed(bus, "unit", "cut/x")
        texts = [text for name in RUBBISH for text in (name, f"after {name}")]
        source.do("put_texts", key="cut/x", payloads=texts, congestion="BLOCK")
        samples = sink.do("wait", count=len(texts), timeout=60)
        assert [each.decode() for each in payloads(samples, "cut/x")] == texts
        assert {each["key"] for each in samples} == {"cut/x"}
        assert bus.drain(60)
        counts = bus.counts()["cut/x"]
        assert (counts.received, counts.forwarded) == (len(texts), len(texts))
        errors = interceptors.errors["Rubbish"]
        assert errors.count == len(RUBBISH)
        assert not bus.losses
        assert_balanced(bus)


def test_messages_go_on_although_an_interceptor_fails_to_count_what_it_rewrote() -> None:
    called = threading.Event()

    class Forgetful:
        def rewriter(self, kind: object, key: str, payload: bytes) -> Callable[[bytes], bytes]:
            return bytes.upper

        def rewrote(self, key: str, count: int) -> None:
            called.set()
            raise RuntimeError("cannot count")

        def message(self, event: Event) -> None:
            event.replace(event.payload.upper())

    interceptors = pipeline(Forgetful())
    interceptors.provenance = False
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=interceptors) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe", key="**")
        subscribed(bus, "unit", "cut/x")
        texts = [f"m{number}" for number in range(200)]
        for text in texts[:5]:  # one after the other: each is counted on its own
            source.do("put_texts", key="cut/x", payloads=[text], congestion="BLOCK")
        source.do("put_texts", key="cut/x", payloads=texts[5:], congestion="BLOCK")
        samples = sink.do("wait", count=len(texts), timeout=60)
        assert [each.decode() for each in payloads(samples, "cut/x")] == [text.upper() for text in texts]
        assert called.is_set()
        assert bus.drain(60)
        assert bus.counts()["cut/x"].forwarded == len(texts)
        assert not bus.losses
        assert_balanced(bus)


def test_what_an_interceptor_returns_and_how_much_it_copies_do_no_harm() -> None:
    class Generous:
        def message(self, event: Event) -> Any:
            event.duplicate(9_999)
            for number in range(10_000):
                event.add(Message(0, "cut/added", number.to_bytes(8, "little")))
            return object()

    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Generous()), budget_s=60.0) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_numbers", key="cut/x")
        subscribed(bus, "unit", "cut/x")
        source.do("flood", key="cut/x", count=1)
        assert sink.do("wait_numbers", count=10_000) == {"count": 10_000, "ordered": True, "different": 1}
        assert bus.drain(60)
        counts = bus.counts()
        assert (counts["cut/x"].added, counts["cut/x"].forwarded) == (9_999, 10_000)
        assert (counts["cut/added"].added, counts["cut/added"].forwarded) == (10_000, 10_000)
        assert_balanced(bus)


def test_interceptors_that_hang_cost_neither_a_message_nor_the_order() -> None:
    class Hanging:
        def __init__(self) -> None:
            self.let_go = threading.Event()
            self.caught = threading.Event()

        def message(self, event: Event) -> None:
            if event.index >= 500:
                self.caught.set()
                self.let_go.wait(60)
                event.drop()  # too late

    count = 5000
    first, second = Hanging(), Hanging()
    with (
        Bus(SEGMENTS, intercept=["cut/**", "other/**"], pipeline=pipeline(first, second), budget_s=0.2) as bus,
        Puppet(bus.endpoint("system")) as one,
        Puppet(bus.endpoint("unit")) as two,
    ):
        try:
            one.do("subscribe_numbers", key="other/x")
            two.do("subscribe_numbers", key="cut/x")
            subscribed(bus, "system", "other/x")
            subscribed(bus, "unit", "cut/x")
            one.start("flood", key="cut/x", count=count)
            two.start("flood", key="other/x", count=count)
            one.answer(), two.answer()
            assert one.do("wait_numbers", count=count) == everything(count)
            assert two.do("wait_numbers", count=count) == everything(count)
            assert first.caught.is_set()
            assert second.caught.is_set()
            errors = bus.executor.pipeline.errors
            assert {name: each.count for name, each in errors.items()} == {"Hanging": 1, "Hanging#2": 1}
        finally:
            first.let_go.set()
            second.let_go.set()
        assert wait_until(lambda: not stuck_lanes(), 60), stuck_lanes()
        assert bus.drain(60)
        rows = {topic: (each.received, each.forwarded) for topic, each in bus.counts().items()}
        assert rows == {"cut/x": (count, count), "other/x": (count, count)}
        assert not bus.losses
        assert_balanced(bus)


def stuck_lanes() -> list[str]:
    """Lanes' threads beyond the four that two expressions and two segments have."""
    names = [each.name for each in threading.enumerate() if each.name.startswith("riot-forward-")]
    return names[4:]


def test_a_bus_closes_although_an_interceptor_hangs() -> None:
    let_go = threading.Event()

    class Hanging:
        def message(self, event: Event) -> None:
            let_go.wait(60)

    bus = Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Hanging()), budget_s=0.2)
    closing = threading.Thread(target=bus.close, daemon=True)
    with bus, Puppet(bus.endpoint("system")) as source, Puppet(bus.endpoint("unit")) as sink:
        try:
            sink.do("subscribe", key="cut/**")
            sink.do("queryable", key="past/x")
            subscribed(bus, "unit", "cut/x")
            source.do("put_texts", key="cut/x", payloads=["a", "b"], congestion="BLOCK")
            # what was sent before a query that is answered is in the router, too
            assert wait_until(lambda: bool(source.do("get", key="past/x")), 60)
            assert wait_until(lambda: bool(bus.executor.pipeline.current), 60)
            closing.start()
            closing.join(30)
            assert not closing.is_alive()
            assert payloads(sink.do("wait", count=2), "cut/x") == [b"a", b"b"]
        finally:
            let_go.set()
    assert bus.counts()["cut/x"].forwarded == 2
    assert_balanced(bus)
