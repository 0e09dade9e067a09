"""Interceptors are told who comes and goes; the graph and the worker's thread are fakes."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control import watches
from riot_bus.control.watches import Watches
from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.types.registry import TypeRegistry

AA, BB = ConnectedComponent("in", "aa"), ConnectedComponent("out", "bb")


class Stage:
    """An interceptor with some of the hooks."""

    def __init__(self, *hooks: str) -> None:
        self.hooks = hooks

    def hook(self, name: str) -> object:
        return print if name in self.hooks else None


class Scene:
    """A bus with two interceptors, and the doubles of what watches it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        scene = self
        self.told: list[tuple[object, ...]] = []
        self.log: list[str] = []
        self.graphs: list[Graph] = []
        self.fails = False
        self.both, self.one = Stage("joined", "left"), Stage("left")
        executor = SimpleNamespace(pipeline=SimpleNamespace(stages=[self.both, self.one]), call=self._call)
        self.bus: Any = SimpleNamespace(executor=executor, senders=dict)

        class Double:
            def __init__(self, name: str) -> None:
                self.name, self.graph, self.age, self.bypasses = name, Graph(), 0.25, ["a way"]

            def __enter__(self) -> Double:
                if scene.fails and self.name == "bypasses":
                    raise OSError("no network")
                scene.log.append(f"{self.name} starts")
                return self

            def __exit__(self, *error: object) -> None:
                self.close()

            def close(self) -> None:
                scene.log.append(f"{self.name} ends")

            def do(self, job: Callable[[], None]) -> None:
                job()

        def watch(bus: object, take: Any, **_: Any) -> Double:
            self.take = take
            return Double("graph")

        monkeypatch.setattr("riot_bus.graph.watch.GraphWatch", watch)
        monkeypatch.setattr("riot_bus.control.bypass.BypassWatch", lambda *_, **__: Double("bypasses"))
        monkeypatch.setattr(watches, "Worker", lambda name: Double("worker"))

    def _call(self, stage: Stage, hook: str, component: ConnectedComponent, *, worker: object) -> None:
        self.told.append((stage, hook, component.zid))

    def made(self, alarm: Any = None) -> Watches:
        return Watches(self.bus, registry=TypeRegistry(), changed=self.graphs.append, alarm=alarm, scouting=None)


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(monkeypatch)


def test_interceptors_with_the_hook_are_told_who_joins_and_leaves(scene: Scene) -> None:
    first, second, third = (Graph(components=each) for each in ((AA,), (AA, BB), (BB,)))
    with scene.made():
        for graph in (first, second, second, third):
            scene.take(graph, ())
    assert scene.told == [
        (scene.both, "joined", "aa"),
        (scene.both, "joined", "bb"),
        (scene.both, "left", "aa"),
        (scene.one, "left", "aa"),
    ]
    assert scene.graphs == [first, second, second, third]


def test_a_component_that_changes_its_segment_leaves_and_joins(scene: Scene) -> None:
    with scene.made():
        scene.take(Graph(components=(AA,)), ())
        scene.take(Graph(components=(ConnectedComponent("out", "aa", name="now named"),)), ())
        scene.take(Graph(components=(ConnectedComponent("out", "aa"),)), ())  # a name is no newcomer
    assert [hook for stage, hook, _ in scene.told if stage is scene.both] == ["joined", "joined", "left"]


def test_ways_around_are_only_looked_for_if_somebody_wants_to_know(scene: Scene) -> None:
    quiet = scene.made()
    assert quiet.bypasses == []
    assert (quiet.graph, quiet.graph_age) == (Graph(), 0.25)
    with quiet:
        pass
    assert scene.log == ["graph starts", "graph ends", "worker ends"]
    assert scene.made(alarm=print).bypasses == ["a way"]


def test_what_has_started_ends_if_the_rest_cannot_start(scene: Scene) -> None:
    scene.fails = True
    with pytest.raises(OSError, match="no network"), scene.made(alarm=print):
        pass
    assert scene.log == ["graph starts", "graph ends", "worker ends"]
