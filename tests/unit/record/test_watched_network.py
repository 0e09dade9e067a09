from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from riot_bus.record.watched_network import WatchedNetwork


def subscriber(flows: dict[str, int], senders: dict[str, set[str]]) -> Any:
    return SimpleNamespace(flows=flows, senders=lambda: senders)


def test_all_subscribers_of_the_moment_are_one_segment_without_a_name() -> None:
    session: Any = SimpleNamespace(info=SimpleNamespace(zid=lambda: 0xABC))
    subscribers = [subscriber({"a": 3}, {"a": {"x", "y"}})]
    network = WatchedNetwork(session, lambda: subscribers)
    assert network.flows() == {("a", ""): 3}
    subscribers.append(subscriber({"b": 1}, {"b": {"z"}}))
    assert network.flows() == {("a", ""): 3, ("b", ""): 1}
    assert network.senders() == {("a", ""): {"x", "y"}, ("b", ""): {"z"}}
    assert (network.ids, network.sessions) == ({str(0xABC)}, {"": session})
