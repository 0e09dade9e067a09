"""What is gathered of all segments, and kept in between; segments are fakes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.graph import observe
from riot_bus.graph.observe import Observer
from riot_bus.graph.processes import SocketOwner
from riot_bus.types.capabilities import Announcement
from riot_bus.types.registry import TypeRegistry
from riot_bus.zenoh.session_config import control_id


class Source:
    """A segment that sees what a test says."""

    def __init__(self, session: Any, registry: TypeRegistry, changed: object) -> None:
        self.session = session
        self.watched: list[str] = []
        session.source = self

    def modes(self) -> dict[str, str]:
        return dict(self.session.modes)

    def addresses(self) -> dict[str, list[str]]:
        return {zid: [f"tcp/{zid}:1"] for zid in self.session.modes}

    def tokens(self) -> list[Announcement]:
        return self.session.tokens

    def watch_matching(self, keys: list[str]) -> None:
        self.watched += keys

    def matching(self) -> set[str]:
        return {key for key in self.watched if key.startswith("read")}


class World:
    """A bus of two segments, a clock, and what its network and host say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.asked, self.looked_up = 100.0, 0, []
        self.names: dict[str, str] = {}
        self.sessions = {each: SimpleNamespace(modes={}, tokens=[]) for each in ("in", "out")}
        self.counts: dict[tuple[str, str], int] = {}
        bus: Any = SimpleNamespace(
            sessions=self.sessions,
            ids={"ours"},
            ids_ever={"ours", "former"},
            intercepted=["cut/**"],
            services=["call"],
            bridged=(),
            flows=lambda: dict(self.counts),
        )
        monkeypatch.setattr(observe, "SegmentSource", Source)
        monkeypatch.setattr(observe, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(observe, "admin_views", self._views)
        monkeypatch.setattr(observe, "owners", self._owners)
        self.observer = Observer(bus, lambda: None, senders=dict, registry=TypeRegistry(), processes=True)

    def _views(self, session: Any) -> dict[str, Any]:
        self.asked += 1
        return {zid: SimpleNamespace(name=name) for zid, name in self.names.items()}

    def _owners(self, addresses: set[str]) -> dict[str, SocketOwner]:
        self.looked_up.append(sorted(addresses))
        return {each: SocketOwner(3, "talker") for each in addresses if "aa" in each}

    def look(self, later: float = 1.0) -> Any:
        self.now += later
        return self.observer.observe()


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    return World(monkeypatch)


def test_our_own_sessions_are_no_components(world: World) -> None:
    world.sessions["in"].modes = {"aa": "client", "ours": "router", "former": "router", control_id(): "client"}
    world.sessions["in"].tokens = [
        Announcement(zid, "publishes", "k", "", "", "", "advanced token") for zid in ("aa", "former")
    ]
    seen = world.look()
    assert seen.sessions == {("in", "aa"): "client"}
    assert seen.addresses == {("in", "aa"): ["tcp/aa:1"]}
    assert {each.zid for each in seen.tokens} == {"aa"}
    assert (seen.intercepted("cut/x"), seen.intercepted("call"), seen.calls_intercepted("call")) == (True, False, True)


def test_rates_are_those_between_looks_that_are_not_too_close(world: World) -> None:
    world.counts = {("k", "in"): 10}
    world.look()
    world.counts = {("k", "in"): 30}
    assert world.look(4.0).rates == {("k", "in"): 5.0}
    world.counts = {("k", "in"): 31, ("new", "in"): 1}
    soon = world.look(0.02)
    assert soon.rates == {("k", "in"): 5.0}
    assert soon.flows == {("k", "in"): 30, ("new", "in"): 1}
    assert world.look(0.98).rates == {("k", "in"): 1.0, ("new", "in"): 0.0}


def test_receivers_are_watched_for_frequent_and_announced_keys_first(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observe, "_MOST_WATCHED", 8)
    monkeypatch.setattr(observe, "_MOST_SELDOM", 4)
    world.counts = {(f"seldom{n}", "in"): 1 for n in range(5)} | {("read", "in"): 99, ("a/*", "in"): 99}
    world.sessions["out"].tokens = [Announcement("bb", "publishes", "told", "", "", "", "advanced token")]
    seen = world.look()
    assert world.sessions["in"].source.watched == world.sessions["out"].source.watched == ["read", "told"]
    assert seen.skipped == 5
    assert set(seen.matching) == {("in", "read"), ("out", "read")}
    world.counts |= {(f"seldom{n}", "in"): 7 for n in range(5)}
    assert world.look().skipped == 3
    assert len(world.sessions["in"].source.watched) == 4


def test_of_too_many_keys_the_busiest_are_shown(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observe, "_MOST_FLOWS", 2)
    world.counts = {("a", "in"): 5, ("b", "in"): 5}
    assert not world.look().left_out
    world.counts = {("c", "in"): 5, ("d", "in"): 4} | world.counts
    seen = world.look()
    assert seen.left_out
    assert set(seen.flows) == {("a", "in"), ("b", "in")}  # which are as busy as others, but are shown already
    world.counts[("d", "in")] = 6
    assert ("d", "in") in world.look().flows


def test_newcomers_are_asked_for_their_names_a_few_times(world: World) -> None:
    world.sessions["in"].modes = {"aa": "client", "bb": "client"}
    world.names = {"aa": "talker", "elsewhere": "x"}
    assert world.look().names == {"aa": "talker", "elsewhere": "x"}
    for _ in range(9):
        world.look()
    assert world.asked == 2 * 5  # both segments, for bb
    world.sessions["in"].modes = {"aa": "client", "cc": "peer"}
    world.names = {"cc": "late"}
    assert world.look().names == {"aa": "talker", "cc": "late"}
    world.look()
    assert world.asked == 2 * 6


def test_processes_are_looked_up_once_per_address(world: World) -> None:
    world.sessions["in"].modes = {"aa": "client"}
    assert world.look().owners == {"tcp/aa:1": SocketOwner(3, "talker")}
    world.sessions["in"].modes = {"aa": "client", "bb": "client"}
    assert world.look().owners == world.look().owners == {"tcp/aa:1": SocketOwner(3, "talker")}
    world.sessions["in"].modes = {}
    assert world.look().owners == {}
    assert world.looked_up == [["tcp/aa:1"], ["tcp/bb:1"]]
