"""A network that stays open for the next trial of its kind, as if it were new."""

from __future__ import annotations

import pytest

from riot_bus.router.bus import Bus
from riot_bus.trial.kept_network import KeptNetwork
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import wait_until

SEGMENTS = ["inside", "outside"]
WAIT_S = 10.0


def use(network: Network) -> list[str]:
    """Use a network as a trial does, with a component on the inside; return the keys that arrived there."""
    got: list[str] = []
    with Bus(network, intercept=["cut/**"]) as bus, open_client(bus.endpoint("inside")) as component:
        own: list[str] = []
        bus.subscribe("inside", "**", lambda message: own.append(message.key))
        component.subscribe("**", lambda message: got.append(message.key))
        assert bus.wait_subscribed("outside", ["free/b"], timeout=WAIT_S) == []
        assert bus.wait_subscribed("inside", ["cut/a"], timeout=WAIT_S) == []
        for key in ("cut/a", "free/b"):
            bus.put("outside", Message(0, key, b"1"))
        assert wait_until(lambda: len(got) == len(own) == 2, WAIT_S)
        assert (bus.intercepted, bus.counts()["cut/a"].received, bool(bus.losses)) == (["cut/**"], 1, False)
    return sorted(got)


def test_the_next_trial_gets_the_same_network_which_knows_nothing_of_the_last_one() -> None:
    kept = KeptNetwork()
    first = kept.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
    for _ in range(5):
        assert use(first) == ["cut/a", "free/b"]
        endpoints = [segment.endpoints for segment in first.segments.values()]
        kept.give_back(first, usable=True)
        again = kept.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
        assert again is first
        assert endpoints == [segment.endpoints for segment in again.segments.values()]
        with Bus(again, intercept=["cut/**"]) as bus:
            missing = bus.wait_subscribed("outside", ["free/b"], timeout=0.0), bus.departures, bus.counts()
        assert missing == (["free/b"], 0, {})
    kept.give_back(first, usable=True)
    kept.close()
    assert all(session.is_closed() for session in first.sessions.values())


@pytest.mark.parametrize(
    "change", [{"wait_before_close_s": 4.0}, {"cut": []}, {"segments": ["inside"]}, {"usable": False}, {"guest": True}]
)
def test_a_network_that_differs_or_is_not_empty_is_closed(
    change: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("riot_bus.trial.kept_network._LEAVE_S", 0.1)
    kept = KeptNetwork()
    network = kept.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
    use(network)
    sessions = list(network.sessions.values())
    kept.give_back(network, usable=bool(change.pop("usable", True)))
    guest = open_client(network.segments["inside"].endpoints[0]) if change.pop("guest", False) else None
    wanted = {"segments": SEGMENTS, "cut": ["cut/**"], "wait_before_close_s": 3.0} | change
    assert kept.take(**wanted) is not network  # type: ignore[arg-type]
    assert all(session.is_closed() for session in sessions)
    if guest is not None:
        guest.close()


def test_a_trial_within_another_gets_a_network_of_its_own() -> None:
    kept = KeptNetwork()
    one, other = (kept.take(SEGMENTS, [], wait_before_close_s=3.0) for _ in range(2))
    assert one is not other
    for each in (one, other):
        each.open()
        kept.give_back(each, usable=True)
    assert all(session.is_closed() for session in one.sessions.values())
    assert kept.take(SEGMENTS, [], wait_before_close_s=3.0) is other
    other.close()
