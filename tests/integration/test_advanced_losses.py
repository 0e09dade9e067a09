"""Advanced pub/sub on intercepted keys: what is lost on the way is recovered as it was intercepted, or reported."""

from __future__ import annotations

from typing import Any

import pytest
import zenoh
from zenoh import ext

from riot_bus.pipeline.event import Event
from riot_bus.zenoh.session import wait_until
from tests.integration.advanced_tools import (
    KEY,
    WAIT_S,
    Listener,
    PlainListener,
    Prefix,
    advertise,
    cached,
    changed,
    long,
    lossy,
    running,
)
from tests.integration.fault_tools import assert_balanced, subscribed

pytestmark = pytest.mark.integration

GAPS = [["0"], [long("1"), long("2"), "3"], [long("4"), "5"]]
"""One gap after the other: zenoh-ext gives up what is lost while it recovers something else."""

TEXTS = [text for part in GAPS for text in part]
SHORT = changed(["0", "3", "5"])


def publish(publisher: Any, listener: Listener, sink: zenoh.Session) -> None:
    """Publish all texts, and wait until the listener has them in order."""
    sent: list[str] = []
    for part in GAPS:
        for text in part:
            publisher.put(text)
        sent += part
        assert listener.wait(len(sent)) == changed(sent)
        cached(sink)  # by now the listener's own questions are answered, too


def test_what_a_receiver_lost_it_recovers_from_the_router() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit", **lossy("ingress"))
        listener, plain, forgoing = Listener(sink), PlainListener(sink), Listener(sink, recovery=False)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=10)
        publish(publisher, listener, sink)
        assert plain.end("x:5") == forgoing.end("x:5") == SHORT
        assert forgoing.until(lambda: sum(forgoing.missed) == 3)
        assert listener.missed == []
        assert bus.drain(60)
        assert bus.counts()[KEY].received == len(TEXTS)  # none of them went through the interceptors again
        assert_balanced(bus)


def test_a_lost_end_is_recovered_after_a_heartbeat_of_the_router() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit", **lossy("ingress"))
        listener = Listener(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=10, heartbeat=0.1)
        publisher.put("0")
        assert listener.wait(1) == cached(sink) == ["x:0"]
        publisher.put(long("1"))
        assert listener.wait(2) == changed(TEXTS[:2])
        assert bus.counts()[KEY].received == 2


def test_what_was_lost_on_the_way_to_the_router_goes_through_the_interceptors_when_recovered() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system", **lossy("egress")), join("unit")
        listener, plain, forgoing = Listener(sink), PlainListener(sink), Listener(sink, recovery=False)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=10, heartbeat=0.1)
        publish(publisher, listener, sink)
        texts = [*TEXTS, long("end")]
        publisher.put(texts[-1])
        assert listener.wait(len(texts)) == changed(texts)
        assert listener.missed == []
        assert plain.end("x:5") == forgoing.end("x:5") == SHORT
        assert forgoing.until(lambda: sum(forgoing.missed) == 3)
        assert cached(sink) == changed(texts)
        publisher.put("live")
        assert listener.end("x:live") == changed([*texts, "live"])
        assert plain.end("x:live") == [*SHORT, "x:live"]
        assert bus.drain(60)
        assert bus.counts()[KEY].received == len(texts) + 1
        assert_balanced(bus)


def test_history_is_in_order_although_messages_were_lost_at_the_very_beginning() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system", **lossy("egress")), join("unit")
        plain = PlainListener(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=10)
        for text in TEXTS:
            publisher.put(text)
        assert plain.end("x:5") == SHORT
        assert wait_until(lambda: cached(sink) == changed(TEXTS), WAIT_S, interval=0.02), cached(sink)
        assert Listener(sink).wait(len(TEXTS)) == changed(TEXTS)
        assert_balanced(bus)


@pytest.mark.parametrize("flow", ["egress", "ingress"])
def test_what_nobody_keeps_is_reported_as_missed(flow: str) -> None:
    filters = {"egress": (lossy("egress"), {}), "ingress": ({}, lossy("ingress"))}[flow]
    with running(Prefix()) as (bus, join):
        source, sink = join("system", **filters[0]), join("unit", **filters[1])
        listener, forgoing = Listener(sink), Listener(sink, recovery=False)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=None)
        for text in TEXTS:
            publisher.put(text)
        for each in (listener, forgoing):
            assert each.end("x:5") == SHORT
            assert each.until(lambda each=each: sum(each.missed) >= 3)  # type: ignore[misc]
            assert each.missed == [2, 1]
        assert cached(sink) == []
        assert_balanced(bus)


def test_a_message_that_an_interceptor_drops_is_not_missed() -> None:
    class Drop:
        def message(self, event: Event) -> None:
            if event.payload in (b"1", b"3"):
                event.drop()

    with running(Drop()) as (bus, join):
        source, sink = join("system"), join("unit")
        listener = Listener(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=None)
        for number in range(5):
            publisher.put(str(number))
        assert listener.end("4") == ["0", "2", "4"]
        assert listener.missed == []
        assert bus.counts()[KEY].dropped == 2


def test_all_that_a_message_carries_crosses_live_and_as_history() -> None:
    def show(sample: zenoh.Sample) -> tuple[object, ...]:
        attachment = None if sample.attachment is None else sample.attachment.to_bytes()
        return str(sample.kind), sample.payload.to_bytes(), str(sample.encoding), attachment

    def delivery(sample: zenoh.Sample) -> tuple[object, ...]:
        return str(sample.priority), str(sample.congestion_control), sample.express

    with running() as (bus, join):
        source, sink = join("system"), join("unit")
        # Without history: that of a delete is an empty put, on a plain router too.
        native, early = Listener(source, history=0), Listener(sink, history=0)
        plain = PlainListener(sink)
        subscribed(bus, "unit", KEY)
        publisher = ext.declare_advanced_publisher(
            source,
            KEY,
            encoding="text/plain",
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
            cache=ext.CacheConfig(5),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        publisher.put("one", attachment="a")
        publisher.put("two", encoding="application/cdr")
        publisher.delete(attachment="gone")
        publisher.put("", attachment="empty")
        for listener in (native, early, plain):
            listener.wait(4)
        for view in (show, delivery):
            expected = [view(sample) for sample in native.samples]
            assert len(expected) == 4
            assert [view(sample) for sample in early.samples] == expected
            assert [view(sample) for sample in plain.samples] == expected
        assert wait_until(lambda: len(cached(sink)) == 4, WAIT_S, interval=0.02)
        there, here = Listener(source), Listener(sink)
        there.wait(4), here.wait(4)
        assert [show(sample) for sample in here.samples] == [show(sample) for sample in there.samples]
        assert_balanced(bus)
