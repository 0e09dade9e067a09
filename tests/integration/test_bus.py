from __future__ import annotations

import contextlib
import os
import signal
import struct
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from riot_bus.config.router_settings import SegmentSettings
from riot_bus.inject.interceptor import Injector
from riot_bus.interceptors.recorder import Recorder
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.event import Event
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router import forwarder as lane
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import wait_until
from tests.integration.access_tools import write_private
from tests.integration.bus_puppet import Puppet
from tests.tiers import scaled

pytestmark = pytest.mark.integration

SEGMENTS = {"system": [], "unit": []}


def pipeline(*interceptors: object) -> Pipeline:
    return Pipeline(interceptors, registry=TypeRegistry())


class Script:
    """Does to each message what its text says."""

    def message(self, event: Event) -> None:
        match event.message.payload:
            case b"drop":
                event.drop()
            case b"late":
                event.delay(0.15)
            case b"twice":
                event.duplicate()
            case b"change":
                event.replace(b"changed")
            case b"more":
                event.add(event.message.with_(payload=b"added"))
            case b"elsewhere":
                event.add(event.message.with_(key="free/added", payload=b"added"))
            case b"raise":
                raise RuntimeError("on purpose")


@contextlib.contextmanager
def pair(bus: Bus, *, subscribe: str = "**") -> Iterator[tuple[Puppet, Puppet]]:
    """A component in each segment; the one in `unit` has subscribed."""
    with Puppet(bus.endpoint("system")) as source, Puppet(bus.endpoint("unit")) as sink:
        sink.do("subscribe", key=subscribe)
        assert bus.wait_subscribed("unit", [subscribe], timeout=60) == []
        yield source, sink


def texts(samples: list[dict[str, str]]) -> list[str]:
    return [bytes.fromhex(sample["payload"]).decode() for sample in samples]


def routed(bus: Bus, key: str) -> None:
    """Wait until subscriptions of `unit` are known in `system`."""
    assert bus.wait_subscribed("system", [key], timeout=60) == []


def test_what_is_not_intercepted_passes_natively() -> None:
    with Bus(SEGMENTS) as bus, pair(bus, subscribe="a/**") as (source, sink):
        source.do("queryable", key="service/x")
        source.do("token", key="alive/me")
        sink.do("tokens", key="alive/**")
        routed(bus, "a/b")
        source.do("put", key="a/b", payload="01", encoding="application/json")
        samples = sink.do("wait", count=2)
        assert {sample["key"] for sample in samples} == {"a/b", "alive/me"}
        assert sink.do("get", key="service/x") == [b"ask".hex()]
        assert bus.counts() == {}
        assert not bus.losses


def test_services_on_intercepted_keys_still_work() -> None:
    with Bus(SEGMENTS, intercept=["cut/**"]) as bus, pair(bus) as (source, sink):
        source.do("queryable", key="cut/service")
        assert wait_until(lambda: sink.do("get", key="cut/service") == [b"ask".hex()], 60)


def test_nothing_leaks_around_the_interceptors() -> None:
    class Nothing:
        def message(self, event: Event) -> None:
            event.drop()

    with Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Nothing())) as bus, pair(bus) as (source, sink):
        source.do("publish_advanced", key="cut/cached", payloads=["old1", "old2"])
        sink.do("subscribe_advanced", key="cut/cached")
        routed(bus, "free/x")
        source.do("put_texts", key="cut/x", payloads=["secret"] * 50, congestion="BLOCK")
        source.do("put_texts", key="free/x", payloads=["end"], congestion="BLOCK")
        assert texts(sink.do("wait", count=1)) == ["end"]
        assert bus.drain(60)
        assert texts(sink.do("wait", count=2, timeout=0.3)) == ["end"]
        assert bus.counts()["cut/x"].dropped == 50
        assert bus.counts()["cut/cached"].dropped == 2


@pytest.mark.parametrize(
    "order",
    [
        {"do": "put", "payload": "00ff"},
        {"do": "put", "payload": "", "encoding": "application/json", "attachment": "00112233"},
        {"do": "put", "payload": "7b", "encoding": "zenoh/bytes;schema", "attachment": ""},
        {"do": "put", "payload": "01", "priority": "REAL_TIME", "congestion": "BLOCK", "express": True},
        {"do": "put", "payload": "01", "priority": "BACKGROUND", "congestion": "BLOCK_FIRST"},
        {"do": "delete", "attachment": "aa", "priority": "DATA_LOW", "congestion": "BLOCK"},
    ],
    ids=["plain", "encoding+attachment", "schema", "urgent", "background", "delete"],
)
def test_an_intercepted_message_is_equal_at_the_receiver(order: dict[str, str]) -> None:
    with Bus(SEGMENTS, intercept=["cut/**"]) as bus, pair(bus, subscribe="cut/**") as (source, sink):
        with Puppet(bus.endpoint("system")) as neighbour:
            neighbour.do("subscribe", key="cut/**")
            assert bus.wait_subscribed("system", ["cut/**"], timeout=60) == []
            source.do(**order, key="cut/a/b")
            (native,) = neighbour.do("wait", count=1)
        assert sink.do("wait", count=1) == [native]


def test_interceptors_drop_delay_copy_change_and_add() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Script())) as bus,
        pair(bus) as (source, sink),
    ):
        routed(bus, "free/x")
        payloads = ["drop", "late", "twice", "change", "more", "elsewhere", "raise", "same"]
        source.do("put_texts", key="cut/x", payloads=payloads, congestion="BLOCK")
        samples = sink.do("wait", count=10)
        expected = ["twice", "twice", "changed", "more", "added", "elsewhere", "raise", "same", "late"]
        assert texts([sample for sample in samples if sample["key"] == "cut/x"]) == expected
        assert [sample["key"] for sample in samples].count("free/added") == 1
        assert bus.drain(60)
        counts = bus.counts()["cut/x"]
        assert (counts.received, counts.dropped, counts.added, counts.forwarded, counts.lost) == (8, 1, 2, 9, 0)


def test_advanced_subscribers_get_copies_and_delayed_messages() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Script())) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_advanced", key="cut/x")
        assert bus.wait_subscribed("unit", ["cut/x"], timeout=60) == []
        source.do("publish_advanced", key="cut/x", payloads=["late", "twice", "same"])
        assert texts(sink.do("wait", count=4)) == ["twice", "twice", "same", "late"]


def test_both_directions_under_load_lose_nothing_and_keep_the_order() -> None:
    count = scaled(100_000)
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("system")) as one,
        Puppet(bus.endpoint("unit")) as two,
    ):
        one.do("subscribe_numbers", key="cut/back")
        two.do("subscribe_numbers", key="cut/forth")
        assert bus.wait_subscribed("system", ["cut/back"], timeout=60) == []
        assert bus.wait_subscribed("unit", ["cut/forth"], timeout=60) == []
        one.start("flood", key="cut/forth", count=count)
        two.start("flood", key="cut/back", count=count)
        one.answer(), two.answer()
        everything = {"count": count, "ordered": True, "different": count}
        assert one.do("wait_numbers", count=count) == everything
        assert two.do("wait_numbers", count=count) == everything
        assert not bus.losses
        assert {name: each.forwarded for name, each in bus.counts().items()} == {"cut/back": count, "cut/forth": count}


class Slow:
    def __init__(self) -> None:
        self.release = threading.Event()

    def message(self, event: Event) -> None:
        self.release.wait(20)


class Sleepy:
    def message(self, event: Event) -> None:
        time.sleep(0.0005)


def test_what_drop_publishers_lose_to_a_slow_interceptor_is_counted() -> None:
    count, sent = 20_000, 0
    with Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Sleepy())) as bus, pair(bus) as (source, _):
        while not bus.losses.reasons.get("no room", 0):  # on a busy machine few of a flood arrive
            assert sent < 20 * count, bus.counts()
            source.do("flood", key="cut/x", count=count, congestion="DROP")
            sent += count
        assert bus.drain(60)
        counts = bus.counts()["cut/x"]
        assert counts.received == counts.forwarded + counts.lost
        assert counts.lost == bus.losses.messages["cut/x"]
        assert counts.received <= sent


def test_block_publishers_wait_for_a_slow_interceptor() -> None:
    count = 15_000
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Sleepy())) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_numbers", key="cut/x")
        assert bus.wait_subscribed("unit", ["cut/x"], timeout=60) == []
        source.start("flood", key="cut/x", count=count)
        assert sink.do("wait_numbers", count=count) == {"count": count, "ordered": True, "different": count}
        source.answer()
        assert not bus.losses


def test_an_interceptor_that_does_not_come_back_is_bypassed_and_traffic_goes_on() -> None:
    slow = Slow()

    class Later:
        def message(self, event: Event) -> None:
            event.replace(event.payload + b"!")

    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(slow, Later()), budget_s=0.2) as bus,
        pair(bus) as (source, sink),
    ):
        source.do("put_texts", key="cut/x", payloads=["a", "b", "c"], congestion="BLOCK")
        assert texts(sink.do("wait", count=3)) == ["a!", "b!", "c!"]
        errors = bus.executor.pipeline.errors["Slow"]
        assert errors.count == 1
        assert "blocked" in errors.first
        assert errors.place.startswith(__file__)
        slow.release.set()  # it comes back, too late: its message has gone on already
        source.do("put_texts", key="cut/x", payloads=["d"], congestion="BLOCK")
        assert texts(sink.do("wait", count=4)) == ["a!", "b!", "c!", "d!"]
        counts = bus.counts()["cut/x"]
        assert (counts.received, counts.forwarded) == (4, 4)


def test_wait_subscribed_names_what_is_missing_and_notices_a_dead_component() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("unit")) as unit,
        Puppet(bus.endpoint("system")) as elsewhere,
    ):
        elsewhere.do("subscribe", key="cut/other/**")
        bus.subscribe("unit", "**", lambda message: None)
        unit.do("subscribe", key="cut/*")
        began = time.monotonic()
        assert bus.wait_subscribed("unit", ["cut/a", "cut/other/a"], timeout=1) == ["cut/other/a"]
        unit.kill()
        assert bus.wait_subscribed("unit", ["cut/a", "cut/other/a"], timeout=30, alive=unit.alive)
        assert time.monotonic() - began < 10


def test_put_goes_to_the_segment_and_through_the_interceptors() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Script())) as bus,
        pair(bus, subscribe="cut/**") as (source, sink),
    ):
        source.do("subscribe", key="cut/**")
        assert bus.wait_subscribed("system", ["cut/**"], timeout=60) == []
        seen: list[Message] = []
        bus.subscribe("unit", "cut/**", seen.append)
        bus.put("system", Message(0, "cut/x", b"change", attachment=b"a", qos=Qos(congestion="block")))
        bus.put("system", Message(0, "cut/y", b"plain", encoding="text/plain", qos=Qos(2)))
        assert sorted(texts(source.do("wait", count=2))) == ["change", "plain"]  # priorities may overtake
        samples = sink.do("wait", count=2)
        assert sorted(texts(samples)) == ["changed", "plain"]
        assert sorted(sample["priority"] for sample in samples) == [2, 5]
        assert wait_until(lambda: len(seen) == 2, 60)
        assert [(each.payload, each.attachment, each.segment) for each in seen] == [
            (b"changed", b"a", "unit"),
            (b"plain", None, "unit"),
        ]


def test_what_stays_intercepted_loses_nothing_whatever_else_changes() -> None:
    steps = (["cut/x"], ["cut/*", "free/**"], ["*/x", "cut/x"], ["cut/**"], ["cut/x", "cut/**"], ["cut/y", "cut/x"])
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        for key in ("cut/x", "cut/y", "free/x"):
            sink.do("subscribe_by_key", key=key)
        assert bus.wait_subscribed("unit", ["cut/x", "cut/y", "free/x"], timeout=60) == []
        for key in ("cut/x", "cut/y", "free/x"):
            source.do("stream", key=key, interval=0.001)
        for expressions in steps:
            before = bus.counts()["cut/x"].received if "cut/x" in bus.counts() else 0
            bus.set_intercept(expressions)
            assert bus.intercepted == expressions
            assert wait_until(lambda before=before: bus.counts()["cut/x"].received > before + 20, 60)
        sent = source.do("stop_streams")
        assert bus.drain(60)
        assert wait_until(lambda: sink.do("by_key")["cut/x"]["count"] >= sent["cut/x"], 60)
        seen = sink.do("by_key")
        assert (seen["cut/x"]["count"], seen["cut/x"]["ordered"]) == (sent["cut/x"], True)
        for key, each in seen.items():
            assert each["different"] == each["count"], (key, each)
        counts = bus.counts()["cut/x"]
        assert (counts.received, counts.forwarded, counts.lost) == (sent["cut/x"], sent["cut/x"], 0)


def test_one_scalar_is_set_in_all_messages_and_what_lacks_it_passes() -> None:
    vector = struct.Struct("<4s3d")
    registry = TypeRegistry(load_adapters(["ros2"]), declared={"cut/x": "geometry_msgs/msg/Vector3"})
    injector = Injector([Injection("cut/x", "y", 9.5)])
    once = Pipeline([injector], registry=registry, provenance=False)
    with Bus(SEGMENTS, intercept=["cut/**"], pipeline=once, registry=registry) as bus, pair(bus) as (source, sink):
        payloads = [vector.pack(b"\0\1\0\0", n, 0.0, -n) for n in range(5)]
        short = b"\0\1\0\0" + bytes(8)
        for number, payload in enumerate([*payloads[:3], short, b"", *payloads[3:]]):
            more = {"encoding": "application/cdr;v"} if number % 2 else {"attachment": "0a", "priority": "DATA_HIGH"}
            source.do("put", key="cut/x", payload=payload.hex(), congestion="BLOCK", **(more if number < 3 else {}))
        source.do("delete", key="cut/x", congestion="BLOCK")
        samples = sink.do("wait", count=8)
        changed = [vector.pack(b"\0\1\0\0", n, 9.5, -n).hex() for n in range(5)]
        arrived = [sample["payload"] for sample in samples]
        assert sorted(arrived) == sorted([*changed, short.hex(), "", ""])  # priorities may overtake
        first = next(sample for sample in samples if sample["payload"] == changed[0])
        assert (first["attachment"], first["priority"]) == ("0a", 4)
        assert next(sample for sample in samples if sample["payload"] == changed[1])["encoding"] == "application/cdr;v"
        assert bus.drain(60)
        assert injector.hits == {0: 5}
        assert sum(injector.skipped.values()) == 3
        counts = bus.counts()["cut/x"]
        assert (counts.received, counts.changed, counts.forwarded, counts.lost) == (8, 5, 8, 0)
        bus.set_interceptors([])
        source.do("put", key="cut/x", payload=payloads[0].hex(), congestion="BLOCK")
        assert sink.do("wait", count=9)[-1]["payload"] == payloads[0].hex()


def test_overlapping_expressions_deliver_once() -> None:
    with Bus(SEGMENTS, intercept=["cut/**", "cut/x", "*/x"]) as bus, pair(bus) as (source, sink):
        source.do("put_texts", key="cut/x", payloads=["one", "two"], congestion="BLOCK")
        assert texts(sink.do("wait", count=2)) == ["one", "two"]
        assert bus.drain(60)
        assert texts(sink.do("wait", count=3, timeout=0.2)) == ["one", "two"]


def test_the_cut_can_be_changed_while_components_stay() -> None:
    with (
        Bus(SEGMENTS, intercept=["a/**"], pipeline=pipeline(Script())) as bus,
        pair(bus) as (source, sink),
    ):
        first = bus.ids
        bus.set_intercept(["b/**"])
        assert len(first & bus.ids) == 2
        routed(bus, "free/x")
        for key in ("a/x", "b/x"):
            source.do("put_texts", key=key, payloads=["change"], congestion="BLOCK")
        samples = sink.do("wait", count=2)
        assert sorted(zip([each["key"] for each in samples], texts(samples), strict=True)) == [
            ("a/x", "change"),
            ("b/x", "changed"),
        ]
        assert not bus.losses


@pytest.mark.parametrize("begun", [None, [], ["cut/**"]])
def test_a_network_may_be_open_before_the_bus_and_after_it(begun: list[str] | None) -> None:
    with Network(SEGMENTS) as network, Puppet(network.segments["unit"].endpoints[0]) as sink:
        sink.do("subscribe", key="**")
        assert network.junction is not None
        if begun is not None:
            network.junction.begin(begun)
        first = network.junction.zid
        with Bus(network, intercept=["cut/**"], pipeline=pipeline(Script())) as bus:
            assert (bus.segment("unit"), network.junction.zid == first) == (
                network.segments["unit"],
                begun == ["cut/**"],
            )
            with Puppet(bus.endpoint("system")) as source:
                routed(bus, "free/x")
                for key in ("cut/x", "free/x"):
                    source.do("put_texts", key=key, payloads=["change"], congestion="BLOCK")
                samples = sink.do("wait", count=2)
                found = sorted(zip([each["key"] for each in samples], texts(samples), strict=True))
                assert found == [("cut/x", "changed"), ("free/x", "change")]
                assert not bus.losses
        with Bus(network, intercept=["cut/**"]) as bus, Puppet(bus.endpoint("system")) as source:
            source.do("put_texts", key="cut/x", payloads=["unchanged"], congestion="BLOCK")
            assert texts(sink.do("wait", count=3))[2:] == ["unchanged"]
            assert bus.drain(60)
            assert bus.counts()["cut/x"].received == 1
    assert network.segments["unit"].session.is_closed()


def test_two_buses_in_one_process_do_not_meet() -> None:
    with Bus(SEGMENTS, intercept=["cut/**"]) as one, Bus(SEGMENTS, intercept=["cut/**"]) as two:
        assert len(one.ids | two.ids) == 6
        with pair(one) as (source, sink), pair(two) as (_, other):
            routed(one, "free/x")
            source.do("put_texts", key="cut/x", payloads=["mine"])
            source.do("put_texts", key="free/x", payloads=["mine"])
            assert len(sink.do("wait", count=2)) == 2
            assert other.do("wait", count=1, timeout=0.2) == []


def test_peers_of_different_segments_stay_apart() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Script())) as bus,
        Puppet(bus.endpoint("system"), mode="peer") as source,
        Puppet(bus.endpoint("unit"), mode="peer") as sink,
    ):
        sink.do("subscribe", key="cut/x")
        assert bus.wait_subscribed("unit", ["cut/x"], timeout=60) == []
        source.do("declare", key="cut/x")
        source.do("put_texts", key="cut/x", payloads=["drop", "change"], congestion="BLOCK")
        assert texts(sink.do("wait", count=1)) == ["changed"]


def test_a_link_that_breaks_under_load_is_reported() -> None:
    with Bus(SEGMENTS, intercept=["cut/**"], wait_before_close_s=0.2) as bus, pair(bus) as (source, sink):
        os.kill(sink.process.pid, signal.SIGSTOP)
        try:
            source.start("flood", key="cut/x", count=3000, padding=10_000)
            assert wait_until(lambda: bool(bus.losses.links), 60)
        finally:
            os.kill(sink.process.pid, signal.SIGCONT)
        (link, *_) = bus.losses.links
        assert (link.segment, link.peer, link.reason) == ("unit", sink.zid, "stalled")


def test_components_that_leave_are_no_loss() -> None:
    with Bus(SEGMENTS, intercept=["cut/**"]) as bus:
        with pair(bus) as (source, sink):
            source.do("put_texts", key="cut/x", payloads=["a"])
            sink.do("wait", count=1)
        assert wait_until(lambda: bus.departures == 2, 60)
        assert not bus.losses


def test_port_in_use_names_the_endpoint_and_a_way_out() -> None:
    with Bus({"only": []}) as bus:
        endpoint = bus.endpoint("only")
        with pytest.raises(EnvironmentFaultError) as caught:
            Bus({"a": [], "b": [endpoint]}).open()
        assert f"{endpoint} is in use" in str(caught.value)
        assert "segment 'b'" in str(caught.value)
        assert "--segment" in str(caught.value)


def test_nobody_at_an_endpoint() -> None:
    with pytest.raises(EnvironmentFaultError, match=r"nobody answers at tcp/127\.0\.0\.1:1"):
        open_client("tcp/127.0.0.1:1")


def test_wrong_configuration_is_explained() -> None:
    with pytest.raises(ConfigError, match="no/such/key"):
        Bus({"only": []}, config={"no/such/key": 1}).open()
    with pytest.raises(ConfigError, match="a//b"):
        Bus(SEGMENTS, intercept=["a//b"])
    with pytest.raises(ConfigError, match="at least one segment"):
        Bus({})
    with Bus({"only": []}) as bus, pytest.raises(ConfigError, match="did you mean 'only'"):
        bus.endpoint("onli")


def test_client_speaks_in_messages() -> None:
    with Bus({"only": []}) as bus, open_client(bus.endpoint("only")) as one, open_client(bus.endpoint("only")) as two:
        seen: list[Message] = []
        two.subscribe("a/**", seen.append)
        assert bus.wait_subscribed("only", ["a/x"], timeout=60) == []
        one.declare("a/x", Qos(3, "block", express=True))
        one.put(Message(0, "a/x", b"p", encoding="text/plain", attachment=b"q", qos=Qos(3, "block", express=True)))
        one.put(Message(0, "a/x", b"", kind="delete"))
        assert wait_until(lambda: len(seen) == 2, 60)
        assert seen[0].with_(time=0, sequence=0) == Message(
            0, "a/x", b"p", encoding="text/plain", attachment=b"q", qos=Qos(3, "block", express=True)
        )
        assert seen[1].kind == "delete"


def test_an_observer_of_others_does_not_get_what_we_publish_ourselves() -> None:
    with Bus({"only": []}) as bus, open_client(bus.endpoint("only")) as component:
        every: list[bytes] = []
        others: list[bytes] = []
        bus.subscribe("only", "a/**", lambda message: every.append(message.payload))
        bus.subscribe("only", "a/**", lambda message: others.append(message.payload), own=False)
        component.subscribe("a/x", lambda message: component.put(message.with_(key="a/y", payload=b"answer")))
        assert bus.wait_subscribed("only", ["a/x"], timeout=60) == []
        bus.put("only", Message(0, "a/x", b"ours", qos=Qos(congestion="block")))
        assert wait_until(lambda: len(every) == 2 and others, 60)
        assert bus.drain(60)
        assert (sorted(every), others) == ([b"answer", b"ours"], [b"answer"])


def test_a_slow_interceptor_holds_up_senders_and_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lane, "_BACKLOG", 64)
    monkeypatch.setattr(lane, "_TURN_S", 0.0)  # so each message that is looked at ends the lane's turn, as slow ones do
    waiting: list[int] = []

    class Watcher:
        def message(self, event: Event) -> None:
            waiting.append(sum(len(each._backlog) for each in bus._cut.forwarders()))

    bus = Bus({"system": (), "unit": ()}, intercept=["cut/**"], pipeline=pipeline(Watcher()))
    count = 3000
    with bus, pair(bus) as (source, sink):
        source.do("put_texts", key="cut/x", payloads=["x"] * count, congestion="BLOCK")
        sink.do("wait", count=count)
        assert bus.counts()["cut/x"].forwarded == count
    assert max(waiting) <= 64 + lane._SURPLUS


class MemoryWriter:
    def __init__(self) -> None:
        self.rows: list[tuple[str, Message, tuple[str, ...]]] = []
        self.ticks = 0
        self.closed = False
        self.problem = ""
        self.refused = 0
        self.notes: list[str] = []

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        self.notes.append(name)

    def write(self, message: Message, *, role: str = "delivered", changes: tuple[object, ...] = ()) -> None:
        if message.payload == b"unwritable":
            raise OSError("disk full")
        self.rows.append((role, message, tuple(getattr(change, "action", "") for change in changes)))

    def tick(self) -> None:
        self.ticks += 1

    def flush(self) -> None:
        assert not self.closed

    def close(self) -> None:
        self.closed = True


def test_recorder_keeps_originals_and_what_was_delivered_under_one_number() -> None:
    writer = MemoryWriter()
    recorder = Recorder(writer)
    bus = Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Script()), recorder=recorder, record=["**", "free/x"])
    with bus, pair(bus) as (source, sink):
        # The recorder is a subscriber too, so the bus cannot tell; what is asked after subscribing comes after it.
        source.do("queryable", key="service/x")
        assert wait_until(lambda: sink.do("get", key="service/x") == [b"ask".hex()], 60)
        payloads = ["same", "change", "drop", "late", "unwritable"]
        source.do("put_texts", key="cut/x", payloads=payloads, congestion="BLOCK")
        source.do("put_texts", key="free/x", payloads=["native"], congestion="BLOCK")
        sink.do("wait", count=5)
        assert bus.drain(60)
    recorder.close()
    assert writer.closed
    rows = [(role, each.payload.decode(), actions) for role, each, actions in writer.rows if each.key == "cut/x"]
    assert sorted(rows) == [
        ("delivered", "changed", ("replace",)),
        ("delivered", "late", ("delay",)),
        ("delivered", "same", ()),
        ("original", "change", ("replace",)),
        ("original", "drop", ("drop",)),
        ("original", "late", ("delay",)),
    ]
    numbers = {each.payload: each.sequence for role, each, _ in writer.rows}
    assert numbers[b"change"] == numbers[b"changed"]
    late = {role: each for role, each, _ in writer.rows if each.payload == b"late"}
    assert late["delivered"].time - late["original"].time == 150_000_000
    assert [each.payload for _, each, _ in writer.rows if each.key == "free/x"] == [b"native"]
    assert bus.losses.recordings == {"cut/x": 1}
    assert (bus.counts()["cut/x"].recorded, bus.counts()["free/x"].recorded) == (3, 1)


@pytest.mark.parametrize("declared", [{}, {"cut/x": "json"}], ids=["inferred", "declared"])
@pytest.mark.parametrize("recording", [False, True], ids=["", "recorded"])
def test_injected_messages_arrive_whether_or_not_they_are_recorded(
    declared: dict[str, str], *, recording: bool
) -> None:
    writer = MemoryWriter()
    recorder = Recorder(writer) if recording else None
    injecting = Pipeline([Injector([Injection("cut/x", "y", 9)])], registry=TypeRegistry(declared=declared))
    payloads = [f'{{"n": {number}, "y": 1}}' for number in range(20)]
    expected = [text.replace(": 1}", ": 9}") for text in payloads]
    with Bus(SEGMENTS, intercept=["cut/**"], pipeline=injecting, recorder=recorder) as bus, pair(bus) as (source, sink):
        source.do("put_texts", key="cut/x", payloads=payloads, congestion="BLOCK")
        assert texts(sink.do("wait", count=len(payloads))) == expected
        assert bus.drain(60)
        assert bus.counts()["cut/x"].forwarded == len(payloads)
    if recorder is not None:
        recorder.close()
        assert [each.payload.decode() for role, each, _ in writer.rows if role == "delivered"] == expected
        assert [each.payload.decode() for role, each, _ in writer.rows if role == "original"] == payloads


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_segment_on_which_nothing_is_intercepted_needs_no_threads_for_the_pipeline() -> None:
    def started() -> set[str]:
        return {"riot-executor", "riot-delayed"} & {thread.name for thread in threading.enumerate()}

    with Bus({"only": []}) as bus, open_client(bus.endpoint("only")) as component:
        got: list[bytes] = []
        component.subscribe("cut/x", lambda message: got.append(message.payload))
        assert bus.wait_subscribed("only", ["cut/x"], timeout=60) == []
        assert started() == set()
        bus.set_intercept(["cut/**"])
        bus.set_interceptors([Script()])
        assert started() == {"riot-executor", "riot-delayed"}
        bus.put("only", Message(0, "cut/x", b"late", qos=Qos(congestion="block")))
        assert bus.drain(60)
        assert wait_until(lambda: bool(got), 60)
    assert started() == set()
    with Bus({"only": []}, pipeline=pipeline(Script())):
        assert started() == {"riot-executor", "riot-delayed"}


def test_opening_and_closing_leaves_nothing_behind() -> None:
    def cycle() -> None:
        with Bus(SEGMENTS, intercept=["cut/**"]) as bus:
            bus.subscribe("unit", "**", lambda message: None)

    cycle()
    before = descriptors(), threading.active_count()
    for _ in range(10):
        cycle()
    assert wait_until(lambda: descriptors() <= before[0] + 2 and threading.active_count() <= before[1], 60), (
        before,
        descriptors(),
        threading.active_count(),
    )


def test_a_segment_that_asks_for_passwords_is_joined_and_cut_like_any_other(tmp_path: Path) -> None:
    users = tmp_path / "users.txt"
    write_private(users, "robot:secret\n")
    guarded = SegmentSettings(config={"transport/auth/usrpwd/dictionary_file": str(users)})
    login = {"transport/auth/usrpwd/user": "robot", "transport/auth/usrpwd/password": "secret"}
    with (
        Bus({"system": (), "unit": guarded}) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit"), config=login) as sink,
    ):
        sink.do("subscribe", key="**")
        # Nothing is cut yet: what the source sends reaches the sink once its own segment has heard of the subscription.
        assert bus.wait_subscribed("system", ["cut/x", "free/x"], timeout=60) == []
        for number, cut in enumerate([[], ["cut/**"], [], ["cut/**"], ["cut/x", "free/**"]]):
            bus.set_intercept(cut)
            assert bus.wait_subscribed("unit", ["cut/x", "free/x"], timeout=60) == []
            for key in ("cut/x", "free/x"):
                source.do("put_texts", key=key, payloads=[str(number)], congestion="BLOCK")
            sink.do("wait", count=2 * (number + 1))
        samples = sink.do("wait", count=10)
        assert sorted(texts(samples)) == [str(number) for number in range(5) for _ in range(2)]
        assert bus.counts()["cut/x"].received == 3
        assert not bus.losses


@pytest.mark.parametrize(("word", "when"), [("from", When(source="systm")), ("to", When(target="systm"))])
def test_a_way_from_or_to_an_unknown_segment_is_an_error(word: str, when: When) -> None:
    with Bus(SEGMENTS) as bus, pytest.raises(ConfigError, match=f"{word}.*\n.*'system'"):
        bus.set_interceptors([Selective(Script(), when)])
    with pytest.raises(ConfigError, match="no segment 'systm'"):
        Bus(SEGMENTS, pipeline=pipeline(Selective(Script(), when))).open()


def test_a_message_that_is_changed_on_one_way_only() -> None:
    class Mark:
        def message(self, event: Event) -> None:
            event.replace(event.payload + b"!")

    segments: dict[str, tuple[str, ...]] = {"system": (), "unit": (), "third": ()}
    only = Selective(Mark(), When(target="unit"))
    with (
        Bus(segments, intercept=["cut/**"], pipeline=pipeline(only)) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as unit,
        Puppet(bus.endpoint("third")) as third,
    ):
        for name, sink in (("unit", unit), ("third", third)):
            sink.do("subscribe", key="cut/*")
            assert bus.wait_subscribed(name, ["cut/x"], timeout=60) == []
        source.do("put_texts", key="cut/x", payloads=["a"], congestion="BLOCK")
        assert texts(unit.do("wait", count=1)) == ["a!"]
        assert texts(third.do("wait", count=1)) == ["a"]
