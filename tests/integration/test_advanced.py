"""Advanced pub/sub on intercepted keys: what late joiners get is the intercepted stream, and nothing else."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

import pytest

from riot_bus.pipeline.event import Event
from riot_bus.zenoh.session import wait_until
from tests.integration.advanced_tools import (
    KEY,
    WAIT_S,
    LateLink,
    Listener,
    PlainListener,
    Prefix,
    advertise,
    answered,
    ask,
    cached,
    changed,
    component,
    running,
    tokens,
)
from tests.integration.fault_tools import assert_balanced, subscribed

pytestmark = pytest.mark.integration

NUMBERED = pytest.mark.parametrize("numbered", [True, False], ids=["numbered", "stamped"])


@NUMBERED
@pytest.mark.parametrize(("depth", "count"), [(1, 5), (3, 5), (10, 4)])
def test_a_late_joiner_gets_the_end_of_the_changed_stream_and_then_what_comes(
    depth: int, count: int, *, numbered: bool
) -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        early, plain = Listener(sink), PlainListener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=depth, numbered=numbered)
        texts = [f"m{number}" for number in range(count)]
        for text in texts:
            publisher.put(text)
        stream = changed(texts)
        assert early.wait(count) == stream
        assert wait_until(lambda: cached(sink) == stream[-depth:], WAIT_S, interval=0.02), cached(sink)
        late, shallow, volatile = Listener(sink), Listener(sink, history=2), PlainListener(sink)
        fresh = Listener(join("unit"))
        for each, most in ((late, depth), (shallow, min(depth, 2)), (fresh, depth)):
            assert each.wait(min(count, most)) == stream[-most:]
        publisher.put("live")
        for each, expected in (
            (early, stream),
            (plain, stream),
            (late, stream[-depth:]),
            (fresh, stream[-depth:]),
            (shallow, stream[-min(depth, 2) :]),
            (volatile, []),
        ):
            assert each.end("x:live") == [*expected, "x:live"]
        assert early.missed + late.missed + shallow.missed + fresh.missed == []
        assert bus.drain(60)
        assert (bus.counts()[KEY].received, bus.counts()[KEY].forwarded) == (count + 1, count + 1)
        assert_balanced(bus)


@NUMBERED
def test_who_joins_while_messages_flow_gets_each_once_and_in_order(*, numbered: bool) -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        publisher = advertise(source, depth=5, numbered=numbered)
        stop, sent = threading.Event(), itertools.count()

        def publish() -> None:
            while not stop.wait(0.002):
                publisher.put(str(next(sent)))

        flow = threading.Thread(target=publish)
        flow.start()
        try:
            early = Listener(sink)
            assert early.until(lambda: len(early.samples) > 50)
            assert wait_until(lambda: len(cached(sink)) == 5, WAIT_S, interval=0.02)
            listeners = []
            for _ in range(5):
                listeners.append(listener := Listener(sink, history=5))
                assert listener.until(lambda each=listener: len(each.samples) > 20)  # type: ignore[misc]
        finally:
            stop.set()
            flow.join()
        publisher.put("end")
        last = next(sent) - 1
        for listener in (early, *listeners):
            *numbers, _ = [text.removeprefix("x:") for text in listener.end("x:end")]
            assert [int(text) for text in numbers] == list(range(int(numbers[0]), last + 1))
            assert listener.missed == []
        assert_balanced(bus)


class Held:
    """Holds the forwarder up at the first message of another key, as a busy machine does."""

    def __init__(self) -> None:
        self.reached, self.go_on = threading.Event(), threading.Event()

    def message(self, event: Event) -> None:
        if event.key == "cut/slow":
            self.reached.set()
            self.go_on.wait(WAIT_S)


@NUMBERED
def test_a_history_waits_for_older_messages_that_a_forwarder_has_not_taken_yet(*, numbered: bool) -> None:
    held = Held()
    with running(Prefix(), held) as (bus, join):
        source, sink = join("system"), join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        try:
            source.put("cut/slow", "")
            assert held.reached.wait(WAIT_S)
            publisher = advertise(source, depth=1, numbered=numbered)
            for text in ("m0", "m1", "m2"):
                publisher.put(text)
            assert not wait_until(lambda: early.texts() or cached(sink), 0.6)  # less than an interceptor's budget
        finally:
            held.go_on.set()
        publisher.put("m3")
        assert early.end("x:m3") == ["x:m0", "x:m1", "x:m2", "x:m3"]
        assert early.missed == []
        assert_balanced(bus)


def test_nothing_of_the_original_is_found_around_the_interceptors() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        listener, wide = Listener(sink), Listener(sink, "cut/**")
        listener.detect()
        subscribed(bus, "unit", KEY)
        publisher = advertise(source)
        for text in ("m0", "m1"):
            publisher.put(text)
        assert listener.wait(2) == wide.wait(2) == ["x:m0", "x:m1"]
        for selector in (f"{KEY}/@adv/**", f"{KEY}/@adv/pub/**", "cut/**/@adv/**", "**/@adv/**", "cut/*/@adv/pub/**"):
            assert ask(sink, selector) == ["x:m0", "x:m1"], selector
        assert ask(source, f"{KEY}/@adv/pub/**") == ["m0", "m1"]
        assert wait_until(lambda: tokens(sink) == [bus.segment("unit").zid], WAIT_S, interval=0.02)
        assert set(tokens(source)) == {str(source.info.zid())}
        assert listener.until(lambda: bool(listener.publishers))
        publisher.put("end")
        assert listener.end("x:end") == wide.end("x:end") == ["x:m0", "x:m1", "x:end"]
        publisher.undeclare()
        assert listener.until(lambda: listener.publishers == [True, False])
        assert wait_until(lambda: cached(sink) == tokens(sink) == [], WAIT_S, interval=0.02)


def test_the_originals_are_found_by_who_asks_for_more_than_is_intercepted() -> None:
    """A limit, see docs/advanced-pubsub.md: access control cannot tell such a question from that for another key."""
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        here, there = advertise(source), advertise(source, "free/k")
        here.put("m0")
        there.put("f0")
        assert wait_until(lambda: sorted(ask(sink, "**/@adv/**")) == ["f0", "m0", "x:m0"], WAIT_S, interval=0.02)
        assert cached(sink) == ask(sink, "cut/**/@adv/**") == ["x:m0"]
        assert bus.counts()[KEY].received == 1


@NUMBERED
def test_who_knows_a_publisher_by_its_session_gets_the_changed_history_too(*, numbered: bool) -> None:
    with running(Prefix()) as (_, join):
        source, sink, silent = join("system"), join("unit"), join("system")
        publishers = [advertise(source, depth=2, numbered=numbered) for _ in range(1 + numbered)]
        for number in range(3):
            for publisher in publishers:
                publisher.put(f"m{number}")
        history = ["x:m1", "x:m2"] * len(publishers)
        selector = f"{KEY}/@adv/pub/{source.info.zid()}"
        assert wait_until(lambda: ask(sink, f"{selector}/**") == history, WAIT_S, interval=0.02), ask(sink, selector)
        assert ask(sink, f"{selector}/**?_max=1") == ["x:m2"] * len(publishers)
        assert ask(sink, f"{selector}/*/*") == history
        assert ask(source, f"{selector}/**") == [text.removeprefix("x:") for text in history]
        listener = Listener(sink)
        assert listener.wait(len(history)) == history
        publishers[0].put("end")
        assert sorted(listener.end("x:end")) == sorted([*history, "x:end"])  # by the other way, these got none twice
        # Not who asks for one entity: advanced subscribers do, and they would take unnumbered answers for others.
        assert ask(sink, f"{selector}/1/**") == ask(sink, f"{KEY}/@adv/pub/{silent.info.zid()}/**") == []
        assert [reply.ok for reply in sink.get(f"{selector}/**")] == []  # wants answers on its own key
        for publisher in publishers:
            publisher.undeclare()
        assert wait_until(lambda: ask(sink, f"{selector}/**") == [], WAIT_S, interval=0.02)


def test_who_asks_by_the_session_while_the_history_is_on_its_way_waits_for_it() -> None:
    go_on, caught = threading.Event(), threading.Event()

    class Slow:
        def message(self, event: Event) -> None:
            caught.set()
            go_on.wait(WAIT_S)

    with running(Slow(), budget_s=WAIT_S) as (bus, join), LateLink() as link:
        sink = join("unit")
        source = component("", **link.settings)
        try:
            publisher = advertise(source, depth=2)
            publisher.put("m0")
            link.open(bus.endpoint("system"))
            assert caught.wait(WAIT_S)
            found: list[list[str]] = []
            selector = f"{KEY}/@adv/pub/{source.info.zid()}/**"
            asking = threading.Thread(target=lambda: found.append(ask(sink, selector)))
            asking.start()
            assert cached(sink) == []
            go_on.set()
            asking.join(WAIT_S)
            assert found == [["m0"]]
        finally:
            go_on.set()
            source.close()  # type: ignore[no-untyped-call]


def third(event: Event) -> bool:
    return int(event.payload) % 3 == 1


class Act:
    """Does something to every third message."""

    def __init__(self, act: Callable[[Event], None]) -> None:
        self._act = act

    def message(self, event: Event) -> None:
        if third(event):
            self._act(event)


def more(event: Event) -> None:
    event.add(event.message.with_payload(b"more"))


ACTS: dict[str, tuple[Callable[[Event], None], list[str]]] = {
    "drop": (lambda event: event.drop(), ["0", "2", "3", "5", "6"]),
    "copy": (lambda event: event.duplicate(), ["0", "1", "1", "2", "3", "4", "4", "5", "6"]),
    "delay": (lambda event: event.delay(0.2), ["0", "2", "3", "5", "6", "1", "4"]),
    "add": (more, ["0", "1", "more", "2", "3", "4", "more", "5", "6"]),
}


@NUMBERED
@pytest.mark.parametrize("name", ACTS)
def test_history_is_what_was_delivered(name: str, *, numbered: bool) -> None:
    act, expected = ACTS[name]
    with running(Act(act)) as (bus, join):
        source, sink = join("system"), join("unit")
        early, volatile = Listener(sink), Listener(sink, recovery=False)
        plain = PlainListener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=4, numbered=numbered)
        for number in range(7):
            publisher.put(str(number))
        assert early.wait(len(expected)) == volatile.wait(len(expected)) == plain.wait(len(expected)) == expected
        assert wait_until(lambda: cached(sink) == expected[-4:], WAIT_S, interval=0.02), cached(sink)
        late = Listener(sink)
        late.wait(4)
        publisher.put("9")
        assert late.end("9") == [*expected[-4:], "9"]
        assert early.end("9") == [*expected, "9"]
        assert early.missed + volatile.missed + late.missed == []
        assert bus.drain(60)
        counts = bus.counts()[KEY]
        assert (counts.received, counts.forwarded) == (8, len(expected) + 1)
        assert_balanced(bus)


def test_a_key_of_ros_with_a_latched_topic_has_one_message() -> None:
    key = "0/map/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    with running(Prefix(), intercept=["*/map/*/*"]) as (bus, join):
        source, sink = join("system"), join("unit")
        publisher = advertise(source, key, depth=1, heartbeat=0.1)
        for text in ("old", "new"):
            publisher.put(text)
        assert wait_until(lambda: cached(sink, key) == ["x:new"], WAIT_S, interval=0.02)
        late = Listener(sink, key, history=1)
        assert late.wait(1) == ["x:new"]
        publisher.put("newest")
        assert late.end("x:newest") == ["x:new", "x:newest"]
        assert wait_until(lambda: cached(sink, key) == ["x:newest"], WAIT_S, interval=0.02)
        assert_balanced(bus)


@NUMBERED
def test_what_was_published_before_the_router_was_there_is_history(*, numbered: bool) -> None:
    with running(Prefix()) as (bus, join), LateLink() as link:
        sink = join("unit")
        early, uninterested, plain = Listener(sink), Listener(sink, late=False), PlainListener(sink)
        subscribed(bus, "unit", KEY)
        source = component("", **link.settings)
        try:
            publisher = advertise(source, depth=3, numbered=numbered)
            for number in range(5):
                publisher.put(f"m{number}")
            link.open(bus.endpoint("system"))
            history = ["x:m2", "x:m3", "x:m4"]
            assert early.wait(3) == history
            assert cached(sink) == history
            late = Listener(sink)
            assert late.wait(3) == history
            publisher.put("live")
            assert early.end("x:live") == late.end("x:live") == [*history, "x:live"]
            assert uninterested.end("x:live") == plain.end("x:live") == ["x:live"]
            assert early.missed + late.missed + uninterested.missed == []
            assert bus.drain(60)
            assert bus.counts()[KEY].received == 4
            assert_balanced(bus)
        finally:
            source.close()  # type: ignore[no-untyped-call]


def test_an_interceptor_that_blocks_while_history_is_replayed_is_bypassed() -> None:
    let_go, caught = threading.Event(), threading.Event()

    class Hanging:
        def message(self, event: Event) -> None:
            if event.payload == b"m1":
                caught.set()
                let_go.wait(WAIT_S)
                event.drop()  # too late

    with running(Hanging(), Prefix(), budget_s=0.2) as (bus, join), LateLink() as link:
        early = Listener(join("unit"))
        subscribed(bus, "unit", KEY)
        source = component("", **link.settings)
        try:
            publisher = advertise(source, depth=3)
            for number in range(3):
                publisher.put(f"m{number}")
            link.open(bus.endpoint("system"))
            assert caught.wait(WAIT_S)
            publisher.put("live")  # must wait for the history
            assert early.wait(4) == ["x:m0", "x:m1", "x:m2", "x:live"]
            let_go.set()
            publisher.put("end")
            assert early.end("x:end")[-2:] == ["x:live", "x:end"]
            assert bus.executor.pipeline.errors["Hanging"].count == 1
            assert bus.drain(60)
            assert wait_until(lambda: names("riot-advanced") == 1, WAIT_S), threading.enumerate()
            assert (bus.counts()[KEY].received, bus.counts()[KEY].forwarded) == (5, 5)
            assert_balanced(bus)
        finally:
            let_go.set()
            source.close()  # type: ignore[no-untyped-call]


def names(name: str) -> int:
    return sum(thread.name == name for thread in threading.enumerate())
