"""Advanced pub/sub on intercepted keys: publishers that come, go and meet others, and interception that changes."""

from __future__ import annotations

import gc
import threading

import pytest

from riot_bus.pipeline.event import Event
from riot_bus.router.advanced.proxy_publisher import ProxyPublisher
from riot_bus.router.advanced.publisher_state import PublisherState
from riot_bus.zenoh.session import wait_until
from tests.integration.advanced_tools import (
    KEY,
    WAIT_S,
    Listener,
    PlainListener,
    Prefix,
    advertise,
    answered,
    cached,
    changed,
    component,
    running,
    tokens,
)
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import assert_balanced, subscribed

pytestmark = pytest.mark.integration

NUMBERED = pytest.mark.parametrize("numbered", [True, False], ids=["numbered", "stamped"])


def gone(sink: object) -> bool:
    return cached(sink) == tokens(sink) == []  # type: ignore[arg-type]


def test_the_history_of_a_process_ends_with_it_and_that_of_the_next_one_is_its_own() -> None:
    with running(Prefix()) as (bus, join):
        sink = join("unit")
        early, plain = Listener(sink), PlainListener(sink)
        subscribed(bus, "unit", KEY)
        stream: list[str] = []
        for run in range(3):
            with Puppet(bus.endpoint("system")) as publisher:
                texts = [f"{run}.{number}" for number in range(4)]
                publisher.do("publish_advanced", key=KEY, payloads=texts, depth=2)
                stream += changed(texts)
                assert early.wait(len(stream)) == plain.wait(len(stream)) == stream
                assert wait_until(lambda: cached(sink) == stream[-2:], WAIT_S, interval=0.02)  # noqa: B023
                assert wait_until(lambda: len(tokens(sink)) == 1, WAIT_S, interval=0.02)
                assert Listener(sink).wait(2) == stream[-2:]
            assert wait_until(lambda: gone(sink), WAIT_S, interval=0.02)
        assert early.missed == []
        assert_balanced(bus)


@NUMBERED
def test_a_publisher_that_comes_back_under_its_old_id_begins_anew(*, numbered: bool) -> None:
    with running(Prefix()) as (bus, join):
        sink = join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        stream: list[str] = []
        for run in range(3):
            # a router refuses an id as long as it knows a session of that id
            assert wait_until(lambda: "abc123" not in bus.segment("system").peers(), WAIT_S, interval=0.02)
            source = component(bus.endpoint("system"), id="abc123")
            try:
                publisher = advertise(source, depth=2, numbered=numbered)
                for number in range(3 + run):
                    publisher.put(f"{run}.{number}")
                    stream.append(f"x:{run}.{number}")
                assert early.wait(len(stream)) == stream
                assert wait_until(lambda: cached(sink) == stream[-2:], WAIT_S, interval=0.02), cached(sink)
            finally:
                source.close()  # type: ignore[no-untyped-call]
        assert wait_until(lambda: gone(sink), WAIT_S, interval=0.02)


@NUMBERED
def test_each_of_two_publishers_on_a_key_keeps_its_own_history(*, numbered: bool) -> None:
    with running(Prefix()) as (bus, join):
        one, two, sink = join("system"), join("system"), join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        first, second = advertise(one, depth=1, numbered=numbered), advertise(two, depth=2, numbered=numbered)
        for number in range(3):
            first.put(f"p{number}")
            second.put(f"q{number}")
        expected = sorted(changed(["p0", "p1", "p2", "q0", "q1", "q2"]))
        assert sorted(early.wait(6)) == expected
        history = ["x:p2", "x:q1", "x:q2"]
        assert wait_until(lambda: sorted(cached(sink)) == history, WAIT_S, interval=0.02), cached(sink)
        assert wait_until(lambda: len(tokens(sink)) == 2, WAIT_S, interval=0.02)
        assert sorted(Listener(sink).wait(3)) == history
        assert sorted(Listener(sink, history=1).wait(2)) == ["x:p2", "x:q2"]
        first.undeclare()
        assert wait_until(lambda: len(tokens(sink)) == 1, WAIT_S, interval=0.02)
        assert cached(sink) == history[1:]
        assert early.missed == []
        assert_balanced(bus)


def test_publishers_in_both_segments_hear_each_other_and_not_themselves() -> None:
    with running(Prefix()) as (bus, join):
        sessions = {"system": join("system"), "unit": join("unit")}
        early = {name: Listener(session) for name, session in sessions.items()}
        for name, session in sessions.items():
            answered(session)
            subscribed(bus, name, KEY)
        publishers = {name: advertise(session, depth=2) for name, session in sessions.items()}
        for number in range(4):
            for name, publisher in publishers.items():
                publisher.put(f"{name}{number}")
        for name, other in (("system", "unit"), ("unit", "system")):
            seen = sorted([f"{name}{number}" for number in range(4)] + [f"x:{other}{number}" for number in range(4)])
            assert sorted(early[name].wait(8)) == seen
            history = [f"{name}2", f"{name}3", f"x:{other}2", f"x:{other}3"]
            session = sessions[name]
            assert wait_until(lambda: sorted(cached(session)) == history, WAIT_S, interval=0.02)  # noqa: B023
            assert sorted(Listener(session).wait(4)) == history
        assert_balanced(bus)


@NUMBERED
def test_a_publisher_without_a_token_has_a_history_all_the_same(*, numbered: bool) -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=2, numbered=numbered, visible=False)
        stream: list[str] = []

        def told() -> bool:
            stream.append(f"x:{len(stream)}")
            publisher.put(stream[-1].removeprefix("x:"))
            early.wait(len(stream))
            return len(stream) > 2 and cached(sink) == stream[-2:]

        assert wait_until(told, WAIT_S, interval=0.05), cached(sink)
        assert early.texts() == stream
        assert tokens(sink) == []
        late = Listener(sink)
        assert late.wait(2) == stream[-2:]
        publisher.put("end")
        assert late.end("x:end") == [*stream[-2:], "x:end"]
        assert early.end("x:end") == [*stream, "x:end"]
        assert_balanced(bus)


def test_messages_of_a_plain_publisher_on_the_same_key_are_heard_but_not_kept() -> None:
    with running(Prefix()) as (bus, join):
        source, sink = join("system"), join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        publisher, plain = advertise(source, depth=2), source.declare_publisher(KEY)
        expected = []
        for number in range(3):
            publisher.put(f"p{number}")
            plain.put(f"q{number}")
            expected += changed([f"p{number}", f"q{number}"])
        assert sorted(early.wait(6)) == sorted(expected)
        assert wait_until(lambda: cached(sink) == ["x:p1", "x:p2"], WAIT_S, interval=0.02), cached(sink)
        assert early.missed == []
        assert_balanced(bus)


@NUMBERED
def test_interception_begins_and_ends_while_an_advanced_publisher_goes_on(*, numbered: bool) -> None:
    with running(Prefix(), intercept=[]) as (bus, join):
        source, sink = join("system"), join("unit")
        early, detecting, plain = Listener(sink, late=False), Listener(sink), PlainListener(sink)
        answered(sink)
        subscribed(bus, "system", KEY)
        publisher = advertise(source, depth=3, numbered=numbered)
        for number in range(5):
            publisher.put(f"m{number}")
        stream = [f"m{number}" for number in range(5)]
        assert early.wait(5) == detecting.wait(5) == plain.wait(5) == stream

        bus.set_intercept(["cut/**"])
        subscribed(bus, "unit", KEY)
        history = changed(stream[-3:])
        assert wait_until(lambda: cached(sink) == history, WAIT_S, interval=0.02), cached(sink)
        both = {str(source.info.zid()), bus.segment("unit").zid}  # a limit: the original has crossed, and goes on
        assert wait_until(lambda: set(tokens(sink)) == both, WAIT_S, interval=0.02)
        assert set(tokens(source)) == {str(source.info.zid())}
        late = Listener(sink)
        assert late.wait(3) == history
        for number in range(5, 8):
            publisher.put(f"m{number}")
        assert late.end("x:m7") == [*history, "x:m5", "x:m6", "x:m7"]
        stream += ["x:m5", "x:m6", "x:m7"]
        assert early.end("x:m7") == detecting.end("x:m7") == plain.end("x:m7") == stream
        assert wait_until(lambda: cached(sink) == stream[-3:], WAIT_S, interval=0.02), cached(sink)

        bus.set_intercept([])
        assert wait_until(lambda: tokens(sink) == [str(source.info.zid())], WAIT_S, interval=0.02), tokens(sink)
        assert wait_until(lambda: cached(sink) == ["m5", "m6", "m7"], WAIT_S, interval=0.02), cached(sink)
        subscribed(bus, "system", KEY)
        publisher.put("end")
        assert plain.end("end") == [*stream, "end"]
        # A limit, see docs/advanced-pubsub.md: those who know the publisher from before ask for what came meanwhile.
        for listener in (early, detecting):
            assert [text for text in listener.end("end") if text not in ("m5", "m6", "m7")] == [*stream, "end"]
        assert bus.counts()[KEY].received == 6
        assert_balanced(bus)


def test_publishers_that_end_after_interception_began_leave_no_token() -> None:
    with running(Prefix(), intercept=[]) as (bus, join):
        source, sink = join("system"), join("unit")
        publishers = [advertise(source) for _ in range(3)]
        assert wait_until(lambda: len(tokens(sink)) == 3, WAIT_S, interval=0.02)
        for number, cut in enumerate((["cut/**"], ["cut/*", "other/**"], [])):
            bus.set_intercept(cut)
            publishers[number].undeclare()
            left = (2 - number) * (2 if cut else 1)  # those that have crossed, and while they are intercepted ours
            assert wait_until(lambda: len(tokens(sink)) == left, WAIT_S, interval=0.02), tokens(sink)  # noqa: B023
        bus.set_intercept(["cut/**"])
        publisher = advertise(source)
        assert wait_until(lambda: tokens(sink) == [bus.segment("unit").zid], WAIT_S, interval=0.02), tokens(sink)
        publisher.undeclare()
        assert wait_until(lambda: gone(sink), WAIT_S, interval=0.02)


@NUMBERED
def test_the_depth_is_learned_whenever_the_messages_come(*, numbered: bool) -> None:
    with running() as (bus, join):
        source, sink = join("system"), join("unit")
        early = Listener(sink)
        answered(sink)
        subscribed(bus, "unit", KEY)
        publisher = advertise(source, depth=3, numbered=numbered)
        stream: list[str] = []
        for size in (1, 1, 2, 5, 20):  # each of these ends with nothing more to come
            burst = [str(number) for number in range(len(stream), len(stream) + size)]
            for text in burst:
                publisher.put(text)
            stream += burst
            assert wait_until(lambda: cached(sink) == stream[-3:], WAIT_S, interval=0.01)  # noqa: B023
        assert early.wait(len(stream)) == stream
        publisher.put("end")
        assert early.end("end") == [*stream, "end"]
        assert early.missed == []


def test_what_an_interceptor_adds_to_another_key_is_heard_once_and_not_kept_there() -> None:
    class Elsewhere:
        def message(self, event: Event) -> None:
            event.add(event.message.with_(key="cut/other", payload=b"added"))

    with running(Elsewhere()) as (bus, join):
        source, sink = join("system"), join("unit")
        listener = Listener(sink, "cut/*")
        subscribed(bus, "unit", KEY)
        publisher = advertise(source)
        for text in ("a", "b"):
            publisher.put(text)
        assert sorted(listener.wait(4)) == ["a", "added", "added", "b"]
        assert wait_until(lambda: cached(sink, "cut/**") == ["a", "b"], WAIT_S, interval=0.02)
        assert_balanced(bus)


def alive(kind: type) -> int:
    gc.collect()
    return sum(isinstance(each, kind) for each in gc.get_objects())


def test_publishers_that_come_and_go_leave_nothing() -> None:
    count = 200
    keys = [f"cut/{number}" for number in range(count)]
    with running(Prefix()) as (bus, join):
        sink = join("unit")
        listener = Listener(sink, "cut/**")
        subscribed(bus, "unit", "cut/0")
        before = alive(PublisherState), alive(ProxyPublisher), threading.active_count()
        for run in range(2):
            source = component(bus.endpoint("system"))
            try:
                publishers = [advertise(source, key, depth=2) for key in keys]
                for number, publisher in enumerate(publishers):
                    publisher.put(f"{run}.{number}")
                assert len(set(listener.wait(count * (run + 1)))) == count * (run + 1)
                assert wait_until(lambda: len(tokens(sink, "cut/**")) == count, WAIT_S, interval=0.05)
                assert len(cached(sink, "cut/**")) == count
                if run:  # each says good-bye
                    for publisher in publishers:
                        publisher.undeclare()
                del publishers, publisher
            finally:
                source.close()  # type: ignore[no-untyped-call]
            assert wait_until(lambda: cached(sink, "cut/**") == tokens(sink, "cut/**") == [], WAIT_S, interval=0.05)
            assert wait_until(
                lambda: (alive(PublisherState), alive(ProxyPublisher)) == before[:2], WAIT_S, interval=0.2
            )
        assert wait_until(lambda: threading.active_count() <= before[2], WAIT_S, interval=0.02), threading.enumerate()
        assert len(listener.texts()) == 2 * count
        assert bus.drain(60)
        assert sum(each.received for each in bus.counts().values()) == 2 * count
        assert_balanced(bus)
