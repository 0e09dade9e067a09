"""A router that is changed, opened and closed over and over again loses nothing and leaves nothing behind."""

from __future__ import annotations

import gc

import psutil
import pytest

from riot_bus.router.bus import Bus
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import MIB, SEGMENTS, assert_balanced, received, rss, subscribed

pytestmark = pytest.mark.integration


def test_thirty_changes_of_the_cut_under_traffic_lose_nothing_of_what_stays_cut_and_repeat_nothing() -> None:
    keys = ("keep/x", "turn/x", "free/x")
    with (
        Bus(SEGMENTS, intercept=["keep/**"]) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        for key in keys:
            sink.do("subscribe_by_key", key=key)
        subscribed(bus, "unit", *keys)
        subscribed(bus, "system", "turn/x", "free/x")
        for key in keys:
            source.do("stream", key=key, interval=0.001)
        for number in range(30):
            before = received(bus, "keep/x")
            bus.set_intercept(["keep/**"] if number % 2 else ["turn/**", "keep/**"])
            assert wait_until(lambda before=before: received(bus, "keep/x") >= before + 20, 60)  # type: ignore[misc]
        sent = source.do("stop_streams")
        assert wait_until(lambda: sink.do("by_key")["keep/x"]["count"] >= sent["keep/x"], 60)
        assert bus.drain(60)
        seen = sink.do("by_key")
        assert seen["keep/x"]["count"] == sent["keep/x"]
        for key in keys:
            assert seen[key]["different"] == seen[key]["count"], (key, seen[key])  # nothing twice
            assert seen[key]["ordered"], (key, seen[key])
        assert received(bus, "turn/x") > 0
        assert seen["turn/x"]["count"] > received(bus, "turn/x")  # it went both ways in turn
        assert not bus.losses
        assert len(bus.ids) == 3
        assert_balanced(bus)


@pytest.mark.load
def test_fifty_buses_that_were_opened_and_closed_leave_no_files_threads_or_memory_behind() -> None:
    process = psutil.Process()

    def cycle(number: int) -> None:
        with Bus(SEGMENTS, intercept=["cut/**"]) as bus:
            bus.subscribe("unit", "**", lambda message: None)
            bus.put("system", Message(0, "cut/x", b"x"))
            if number % 5 == 0:
                bus.set_intercept(["cut/**", "more/**"])
            assert bus.drain(60)

    for number in range(10):
        cycle(number)
    gc.collect()
    files, threads, memory = process.num_fds(), process.num_threads(), rss()
    for number in range(50):
        cycle(number)
    gc.collect()
    assert wait_until(lambda: process.num_fds() <= files and process.num_threads() <= threads, 60, interval=0.05), (
        (files, threads),
        (process.num_fds(), process.num_threads()),
    )
    assert rss() - memory < 15 * MIB, (rss() - memory) / MIB
