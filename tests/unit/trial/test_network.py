"""A network that stays open for the next trial of its kind, as if it were new."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.bus import Bus
from riot_bus.trial.network import KeptNetwork, TrialNetwork
from riot_bus.vocabulary.message import Message, Qos
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
    monkeypatch.setattr("riot_bus.trial.network._LEAVE_S", 0.1)
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


class _Bus:
    """A router that notes what is published and subscribed."""

    def __init__(self, *_: object, **__: object) -> None:
        self.put_in: list[tuple[str, Message]] = []
        self.takes: dict[str, Callable[[Message], None]] = {}

    def put(self, segment: str, message: Message) -> None:
        self.put_in.append((segment, message))

    def subscribe(self, segment: str, expression: str, take: Callable[[Message], None], *, own: bool) -> None:
        self.takes[expression] = take


def network(monkeypatch: pytest.MonkeyPatch) -> tuple[TrialNetwork, _Bus]:
    monkeypatch.setattr("riot_bus.trial.network.Bus", _Bus)
    component = SimpleNamespace(attach=None)
    file = SimpleNamespace(components={"part": component}, segment_of=lambda _: "inner")
    registry = SimpleNamespace(matches=lambda topic, key: topic in ("**", key))
    context: Any = SimpleNamespace(file=file, registry=registry, topics=lambda *topics: list(topics))
    made = TrialNetwork(context, segments=["inner"])
    bus: Any = made.bus
    return made, bus


def test_an_output_of_several_watched_topics_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = network(monkeypatch)
    takes: dict[str, Callable[[Message], None]] = {}
    made.watch_outputs(["state", "**"], takes.__setitem__)
    for take in takes.values():
        take(Message(1, "state", b""))
    takes["**"](Message(2, "other", b""))
    assert [message.key for message in made.outputs] == ["state", "other"]


def test_inputs_are_no_outputs(monkeypatch: pytest.MonkeyPatch) -> None:
    made, bus = network(monkeypatch)
    made.watch_all_outputs(segment="inner", inputs=["ask"])
    for key in ("ask", "state", "ask", "state"):
        bus.takes["**"](Message(1, key, b""))
    assert [message.key for message in made.outputs] == ["state", "state"]


def test_published_inputs_wait_for_slow_receivers_and_a_restart_forgets_them(monkeypatch: pytest.MonkeyPatch) -> None:
    made, bus = network(monkeypatch)
    made.now = lambda: 7
    made.put(made.segment_of("part"), Message(1, "ask", b"", qos=Qos(express=True)), batched=True)
    ((segment, sent),) = bus.put_in
    assert (segment, sent.time, sent.qos.congestion, sent.qos.express) == ("inner", 7, "block", False)
    assert made.inputs == [sent]
    made.restart()
    assert (made.inputs, made.outputs) == ([], [])
