from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from riot_bus.control.bypass import Bypass, BypassWatch, find_bypasses
from riot_bus.doctor.checks import check
from riot_bus.router.bus import Bus
from riot_bus.zenoh.scouting import Scouting, scout
from riot_bus.zenoh.session import wait_until
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration


@pytest.fixture
def bus() -> Iterator[Bus]:
    with Bus({"outside": [], "inside": []}, intercept=["cut/**"]) as opened:
        yield opened


@pytest.fixture
def group() -> str:
    """A multicast group of this test's own."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"224.0.0.224:{probe.getsockname()[1]}"


def multicast(group: str) -> dict[str, object]:
    return {
        "scouting__multicast__enabled": True,
        "scouting__multicast__address": group,
        "scouting__multicast__interface": "127.0.0.1",
    }


def zids(found: Bypass) -> set[str]:
    return {each.zid for each in found.components}


def finds(bus: Bus, kind: str, *processes: ZenohProcess, scouting: Scouting | None = None) -> Bypass:
    wanted = {each.zid for each in processes}
    found: list[Bypass] = []

    def there() -> bool:
        found[:] = [
            each for each in find_bypasses(bus, {} if scouting is None else scout(scouting)) if each.kind == kind
        ]
        return any(wanted <= zids(each) for each in found)

    assert wait_until(there, 60, interval=0.02), found
    return next(each for each in found if wanted <= zids(each))


def connected(bus: Bus, segment: str, process: ZenohProcess) -> None:
    assert wait_until(lambda: process.zid in bus.segment(segment).peers(), 60)


def test_components_that_keep_to_their_segments_are_no_alarm(bus: Bus, group: str) -> None:
    with (
        ZenohProcess("client", bus.endpoint("outside")) as one,
        ZenohProcess("peer", bus.endpoint("outside")) as two,
        ZenohProcess("peer", bus.endpoint("outside")) as three,
        ZenohProcess("peer", bus.endpoint("inside")) as four,
    ):
        for each, segment in ((one, "outside"), (two, "outside"), (three, "outside"), (four, "inside")):
            connected(bus, segment, each)
        assert wait_until(lambda: three.zid in two.do("transports", ""), 60)  # peers of one segment may
        assert find_bypasses(bus, scout(Scouting(address=group))) == []


def test_peers_that_find_each_other_by_multicast_are_named(bus: Bus, group: str) -> None:
    how = Scouting(address=group)
    with (
        ZenohProcess("peer", bus.endpoint("outside"), **multicast(group)) as one,
        ZenohProcess("peer", bus.endpoint("inside"), **multicast(group)) as two,
    ):
        assert wait_until(lambda: two.zid in one.do("transports", ""), 60)
        found = finds(bus, "multicast", one, two, scouting=how)
        assert found.active
        assert "scouting/multicast/enabled" in found.cure
        assert {each.pid for each in found.components} == {one.process.pid, two.process.pid}


def test_a_component_that_answers_scouting_is_named_before_anything_happens(bus: Bus, group: str) -> None:
    with ZenohProcess("peer", bus.endpoint("outside"), **multicast(group)) as one:
        found = finds(bus, "multicast", one, scouting=Scouting(address=group))
        assert not found.active
        assert one.locators[0] in found.evidence


def test_a_direct_link_is_seen_without_any_admin_space(bus: Bus) -> None:
    with ZenohProcess("peer", bus.endpoint("outside"), adminspace__enabled=True) as one:
        (locator,) = one.locators
        with ZenohProcess("peer", bus.endpoint("inside"), locator, adminspace__enabled=False) as two:
            found = finds(bus, "direct", one, two)
            assert "connect/endpoints" in found.cure


def test_a_direct_link_between_processes_is_seen_in_their_connections(bus: Bus) -> None:
    from riot_bus.zenoh.session import free_endpoint

    locator = free_endpoint()
    with (
        ZenohProcess("peer", bus.endpoint("outside"), listen__endpoints=[locator], adminspace__enabled=False) as one,
        ZenohProcess("peer", bus.endpoint("inside"), locator, adminspace__enabled=False) as two,
    ):
        found = finds(bus, "direct", one, two)
        assert f"{one.process.pid}" in found.evidence
        assert f"{two.process.pid}" in found.evidence
        assert "TCP" in found.evidence


def test_a_component_in_two_segments_is_named(bus: Bus) -> None:
    with ZenohProcess("peer", bus.endpoint("outside"), bus.endpoint("inside")) as both:
        found = finds(bus, "two segments", both)
        assert [each.segment for each in found.components] == ["inside", "outside"]


def test_a_second_router_between_segments_is_named(bus: Bus) -> None:
    with ZenohProcess("router", bus.endpoint("outside"), bus.endpoint("inside")) as router:
        assert "router" in finds(bus, "router", router).evidence


def test_a_chain_of_foreign_routers_is_named(bus: Bus) -> None:
    with (
        ZenohProcess("router", bus.endpoint("outside")) as one,
        ZenohProcess("router", bus.endpoint("inside"), *one.locators) as two,
    ):
        finds(bus, "router", one, two)


def test_a_foreign_router_beside_the_bus_is_named(bus: Bus) -> None:
    with (
        ZenohProcess("router") as router,
        ZenohProcess("peer", bus.endpoint("outside"), *router.locators) as one,
        ZenohProcess("peer", bus.endpoint("inside"), *router.locators) as two,
    ):
        found = finds(bus, "router", one, two, router)
        assert router.zid in found.cure


def test_the_watch_tells_when_a_way_opens_and_closes(bus: Bus) -> None:
    seen: list[list[Bypass]] = []
    changed = threading.Event()

    def callback(found: list[Bypass]) -> None:
        seen.append(found)
        changed.set()
        raise RuntimeError("on purpose")

    with BypassWatch(bus, callback, period=0.02, scouting=None):
        with ZenohProcess("peer", bus.endpoint("outside"), bus.endpoint("inside")) as both:
            assert changed.wait(10)
            assert zids(seen[0][0]) == {both.zid}
        assert wait_until(lambda: seen[-1] == [], 60)


def test_a_look_is_cheap(bus: Bus) -> None:
    with ZenohProcess("client", bus.endpoint("outside")) as one, ZenohProcess("peer", bus.endpoint("inside")) as two:
        connected(bus, "outside", one)
        connected(bus, "inside", two)
        find_bypasses(bus, {})
        before = time.thread_time()
        for _ in range(10):
            assert find_bypasses(bus, {}) == []
        assert (time.thread_time() - before) / 10 < 0.1  # some milliseconds, on a machine that has time


def test_the_doctor_sees_who_answers_and_which_port_is_taken(bus: Bus, group: str) -> None:
    how = Scouting(address=group)
    with ZenohProcess("peer", bus.endpoint("outside"), **multicast(group)) as one:
        assert wait_until(lambda: one.zid in scout(how, until=[one.zid]), 60)
        checks = {each.name: each for each in check(endpoints=[bus.endpoint("outside")], scouting=how)}
        assert checks["multicast scouting"].status == "warning"
        assert one.zid in checks["multicast scouting"].text
        (port,) = [each for name, each in checks.items() if name.startswith("port")]
        assert port.status == "problem"
