"""What components, interceptors and a router that end or stop can do to the rest, and what must not be lost by it."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import pytest

from riot_bus.control.remote import ask
from riot_bus.router.bus import Bus
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import (
    MIB,
    SEGMENTS,
    assert_balanced,
    assert_rows_balance,
    crosses,
    everything,
    payloads,
    received,
    rss,
    subscribed,
)
from tests.integration.router_process import RouterProcess

pytestmark = pytest.mark.integration


def test_a_publisher_that_is_killed_in_a_burst_harms_nobody() -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("system")) as victim,
        Puppet(bus.endpoint("system")) as other,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_numbers", key="cut/other")
        sink.do("subscribe", key="cut/end")
        subscribed(bus, "unit", "cut/other")
        victim.start("flood", key="cut/victim", count=10_000_000)
        other.start("flood", key="cut/other", count=20_000)
        assert wait_until(lambda: received(bus, "cut/victim") > 1000, 60)
        victim.kill()
        other.answer()
        assert sink.do("wait_numbers", count=20_000) == everything(20_000)
        assert crosses(other, sink, "cut/end", "end"), bus.losses
        assert bus.drain(60)
        assert wait_until(lambda: bus.departures == 1, 60)
        assert not bus.losses
        assert_balanced(bus)


@pytest.mark.parametrize("key", ["cut", "free"])
def test_a_crowd_of_publishers_that_wait_for_one_subscriber_harms_nobody(key: str) -> None:
    """Each may hold up one of the router's threads; if no other is left, its segments wait for each other."""
    groups, sessions, count = 4, 10, 1500
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("unit")) as sink,
        ExitStack() as stack,
    ):
        sink.do("subscribe_by_key", key=f"{key}/**")
        subscribed(bus, "unit", f"{key}/0")
        crowd = [stack.enter_context(Puppet(bus.endpoint("system"))) for _ in range(groups)]
        for number, each in enumerate(crowd):
            each.start("crowd", key=key, first=number * sessions, sessions=sessions, count=count)
        for each in crowd:
            each.answer()
        found: dict[str, dict[str, Any]] = {}

        def complete() -> bool:
            found.update(sink.do("by_key"))
            return sum(each["count"] for each in found.values()) >= groups * sessions * count

        assert wait_until(complete, 60, interval=0.2), bus.losses
        for number in range(groups * sessions):
            report = found[f"{key}/{number}"]
            assert (report["count"], report["different"], report["ordered"]) == (count, count, True)
        assert not bus.losses
        assert_balanced(bus)


def test_a_subscriber_that_is_killed_in_a_burst_harms_nobody() -> None:
    count = 60_000
    with (
        Bus(SEGMENTS, intercept=["cut/**"]) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as victim,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_numbers", key="cut/**")
        subscribed(bus, "unit", "cut/x")
        victim.do("subscribe_numbers", key="cut/**")
        source.start("flood", key="cut/x", count=count)
        assert wait_until(lambda: received(bus, "cut/x") > 1000, 60)
        victim.kill()
        source.answer()
        assert sink.do("wait_numbers", count=count) == everything(count)
        assert bus.drain(60)
        assert bus.counts()["cut/x"].forwarded == count
        assert not bus.losses.messages
        assert_balanced(bus)


@pytest.mark.parametrize("congestion", ["DROP", "BLOCK"])
def test_a_subscriber_that_never_reads_costs_bounded_memory_and_nobody_else(congestion: str) -> None:
    with (
        Bus(SEGMENTS, intercept=["cut/**", "other/**"], wait_before_close_s=0.5) as bus,
        Puppet(bus.endpoint("system")) as flooding,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as stopped,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        stopped.do("subscribe", key="cut/**")
        sink.do("subscribe", key="other/**")
        sink.do("subscribe", key="free/**")
        subscribed(bus, "unit", "cut/x", "other/x", "free/x")
        subscribed(bus, "system", "free/x")
        stopped.pause()
        try:
            before = rss()
            flood: dict[str, Any] = {
                "key": "cut/x",
                "count": 6000,
                "padding": 20_000,
                "congestion": congestion,
            }  # 120 MB

            def much_came() -> bool:
                if congestion == "DROP":  # so its own client drops most of it on a loaded machine
                    flooding.do("flood", **flood)
                return received(bus, "cut/x") > 500

            if congestion == "BLOCK":
                flooding.start("flood", **flood)
            assert wait_until(much_came, 60)
            if congestion == "DROP":
                flooding.start("flood", **flood)
            for key in ("other/x", "free/x"):
                source.do("put_texts", key=key, payloads=[str(n) for n in range(200)], congestion="BLOCK")
            samples = sink.do("wait", count=400, timeout=60)
            for key in ("other/x", "free/x"):
                assert payloads(samples, key) == [str(n).encode() for n in range(200)]
            flooding.answer()
            assert bus.drain(60)
            assert rss() - before < 200 * MIB
        finally:
            stopped.go_on()
        assert crosses(source, stopped, "cut/again", "again"), bus.losses
        if congestion == "BLOCK":  # what waits too long costs the link, and that is said
            assert wait_until(lambda: bool(bus.losses.links), 60)
            links = {(each.segment, each.peer, each.reason) for each in bus.losses.links}
            assert ("unit", stopped.zid, "stalled") in links, links
        assert bus.drain(60)
        assert received(bus, "cut/x") == bus.counts()["cut/x"].forwarded + bus.counts()["cut/x"].lost
        assert_balanced(bus)


def test_clients_come_back_by_themselves_when_the_router_was_killed() -> None:
    with RouterProcess("--intercept=cut/**") as first:
        endpoints = first.endpoints
        with Puppet(endpoints["system"]) as source, Puppet(endpoints["unit"]) as sink:
            sink.do("subscribe", key="**")
            for key in ("cut/x", "free/x"):
                assert crosses(source, sink, key, "first")
            source.start("stream", key="cut/stream", interval=0.001)
            source.answer()
            first.process.kill()
            first.process.wait(60)
            source.do("stop_streams")
            with RouterProcess("--intercept=cut/**", endpoints=endpoints):
                for key in ("cut/x", "free/x"):
                    assert crosses(source, sink, key, "second")
                counts = ask(endpoints["unit"], None, "counts")
                rows = {topic: {**row, "balanced": 0} for topic, row in counts["counts"].items()}
                assert rows["cut/x"]["forwarded"] >= 1
                assert_rows_balance(rows)
                assert counts["losses"]["messages"] == 0
