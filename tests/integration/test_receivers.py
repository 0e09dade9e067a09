from __future__ import annotations

import pytest

from riot_bus.router.bus import Bus
from riot_bus.router.receivers import Receivers
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration


def test_who_subscribes_to_what_is_told_by_segment_though_it_was_for_a_moment() -> None:
    with Bus({"a": (), "b": ()}, intercept=["**"]) as bus, Receivers(bus) as receivers:
        receivers.watch("x")
        receivers.watch("y/*")
        with open_client(bus.endpoint("b")) as client:
            for key, expression in (("x", "x"), ("y/1", "y/*")):
                subscriber = client.subscribe(key, lambda message: None)
                assert wait_until(lambda expression=expression: receivers.heard(expression) == {"b"}, 30)
                subscriber.undeclare()
        assert (receivers.heard("x"), receivers.heard("y/*"), receivers.heard("z")) == ({"b"}, {"b"}, set())


def test_who_was_there_before_is_told_too() -> None:
    with Bus({"a": (), "b": ()}, intercept=["**"]) as bus, open_client(bus.endpoint("a")) as client:
        client.subscribe("x", lambda message: None)
        assert bus.wait_subscribed("a", ["x"], timeout=30) == []
        with Receivers(bus) as receivers:
            receivers.watch("x")
            assert receivers.heard("x") == {"a"}
