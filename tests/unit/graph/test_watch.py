"""The present graph and its changes; the observer is a fake, and no thread is started."""

from __future__ import annotations

import logging
import math
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.graph import watch
from riot_bus.graph.model import ConnectedComponent, Graph, GraphChange
from riot_bus.graph.observations import Observations
from riot_bus.graph.watch import GraphWatch

ONE = Observations(segments=("in",), sessions={("in", "aa"): "client"})
APPEARED = GraphChange("component", "appeared", "aa in in")


class Network:
    """What an observer sees, and a clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.seen, self.now, self.stopped = Observations(segments=("in",)), 5.0, 0
        self.told: list[tuple[Graph, tuple[GraphChange, ...]]] = []
        monkeypatch.setattr(watch, "Observer", lambda *_, **__: self)
        monkeypatch.setattr(watch, "time", SimpleNamespace(monotonic=lambda: self.now))

    def observe(self) -> Observations:
        return self.seen

    def stop(self) -> None:
        self.stopped += 1

    def watching(self, callback: Any = None) -> GraphWatch:
        bus: Any = None
        return GraphWatch(bus, callback or (lambda *each: self.told.append(each)))


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    return Network(monkeypatch)


def test_each_change_is_told_once(network: Network) -> None:
    watching = network.watching()
    watching.refresh()
    known = len(network.told)  # that a segment has nobody may be a statement of its own
    network.seen = ONE
    graph = watching.refresh()
    assert watching.refresh() == watching.graph == graph
    ((told, changes),) = network.told[known:]
    assert told == graph
    assert APPEARED in changes
    assert graph.components == (ConnectedComponent("in", "aa", "client"),)


def test_a_graph_is_as_old_as_the_look_that_it_describes(network: Network) -> None:
    watching = network.watching()
    assert watching.age == math.inf
    watching.refresh()
    network.now += 2.5
    assert watching.age == 2.5


def test_what_listens_may_fail_but_the_graph_goes_on(network: Network, caplog: pytest.LogCaptureFixture) -> None:
    def broken(graph: Graph, changes: object) -> None:
        raise RuntimeError("on purpose")

    watching = network.watching(broken)
    network.seen = ONE
    with caplog.at_level(logging.ERROR):
        graph = watching.refresh()
    assert graph.component("aa") is not None
    assert "what listens to changes of the graph failed" in caplog.text


def test_one_may_ask_for_the_graph_while_a_change_is_told(network: Network) -> None:
    depth = []

    def curious(graph: Graph, changes: object) -> None:
        depth.append(watching.refresh() == graph)

    watching = network.watching(curious)
    network.seen = ONE
    watching.refresh()
    assert depth == [True]


def test_waiting_ends_with_the_condition_or_the_time(network: Network) -> None:
    watching = network.watching()
    assert not watching.wait(lambda graph: bool(graph.components), 0.0)
    network.seen = ONE
    watching.refresh()
    assert watching.wait(lambda graph: bool(graph.components), 0.0)


def test_a_watch_that_was_never_started_can_be_stopped(network: Network) -> None:
    watching = network.watching()
    watching.stop()
    watching.stop()
    assert network.stopped == 2
