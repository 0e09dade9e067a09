"""Whether messages that were intercepted had somewhere to go."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from riot_bus.router.bus import Bus
from riot_bus.zenoh.session import wait_until
from riot_bus_bridges.ros_test.segments import Crossings
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

BOTH = ("system", "unit")
WAIT_S = 30.0


@pytest.fixture
def bus() -> Iterator[Bus]:
    with Bus(dict.fromkeys(BOTH, ("tcp/127.0.0.1:0",)), intercept=["pose", "map/*"]) as one:
        yield one


def component(bus: Bus, segment: str) -> ZenohProcess:
    return ZenohProcess("client", bus.endpoint(segment))


def test_only_what_somebody_elsewhere_had_subscribed_to_has_crossed(bus: Bus) -> None:
    with Crossings(bus) as crossings, component(bus, "system") as talker, component(bus, "system") as neighbour:
        neighbour.do("subscribe", "pose")
        talker.do("put", "pose", "1")
        assert wait_until(lambda: sum(bus.flows().values()) == 1, WAIT_S)
        assert crossings.count(BOTH) == 0
        with component(bus, "unit") as listener:
            listener.do("subscribe", "map/b")
            assert wait_until(lambda: not bus.wait_subscribed("unit", ["map/b"], timeout=1.0), WAIT_S)
        talker.do("put", "map/b", "1")  # the listener is gone: what counts is that it was there
        talker.do("put", "map/b", "2")
        assert wait_until(lambda: sum(bus.flows().values()) == 3, WAIT_S)
        assert crossings.count(BOTH) == 2
        assert crossings.count(["system"]) == 0


def test_subscribers_of_a_segment_are_no_receivers_of_its_own(bus: Bus) -> None:
    with component(bus, "unit") as listener, Crossings(bus) as crossings:
        listener.do("subscribe", "pose")
        with component(bus, "unit") as talker:
            talker.do("put", "pose", "1")
            assert wait_until(lambda: sum(bus.flows().values()) == 1, WAIT_S)
        assert crossings.count(BOTH) == 0
