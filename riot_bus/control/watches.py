"""What a router watches while it runs: the components, who talks to whom, and ways around the router."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Self

from riot_bus.router.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.bypass import BypassWatch
    from riot_bus.control.reach import Bypass
    from riot_bus.graph.model import ConnectedComponent, Graph, GraphChange
    from riot_bus.graph.watch import GraphWatch
    from riot_bus.router.bus import Bus
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh.scouting import Scouting

_LOG = logging.getLogger(__name__)


class Watches:
    """The graph and the bypass alarm of a bus; a context manager.

    Args:
        changed: Called with each new graph.
        alarm: Called with all current ways around the router whenever they change; None to not look for them.
        scouting: Settings for asking who answers multicast scouting; None not to ask.
    """

    def __init__(
        self,
        bus: Bus,
        *,
        registry: TypeRegistry,
        changed: Callable[[Graph], None],
        alarm: Callable[[list[Bypass]], None] | None,
        scouting: Scouting | None,
    ) -> None:
        from riot_bus.graph.watch import GraphWatch

        self._bus = bus
        self._changed = changed
        self._present: dict[tuple[str, str], ConnectedComponent] = {}
        self._graph: GraphWatch = GraphWatch(bus, self._take, senders=bus.senders, registry=registry)
        self._bypasses: BypassWatch | None = None
        if alarm is not None:
            from riot_bus.control.bypass import BypassWatch

            self._bypasses = BypassWatch(bus, alarm, scouting=scouting)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._hooks = Worker("riot-hooks")
            stack.callback(self._hooks.close)
            stack.enter_context(self._graph)
            if self._bypasses is not None:
                stack.enter_context(self._bypasses)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @property
    def graph(self) -> Graph:
        """The present graph."""
        return self._graph.graph

    @property
    def graph_age(self) -> float:
        """Seconds since the look that the present graph describes."""
        return self._graph.age

    @property
    def bypasses(self) -> list[Bypass]:
        """The present ways around the router."""
        return self._bypasses.bypasses if self._bypasses is not None else []

    def _take(self, graph: Graph, changes: tuple[GraphChange, ...]) -> None:
        former, self._present = self._present, {(each.segment, each.zid): each for each in graph.components}
        for who in self._present.keys() - former.keys():
            self._tell("joined", self._present[who])
        for who in former.keys() - self._present.keys():
            self._tell("left", former[who])
        self._changed(graph)

    def _tell(self, hook: str, component: ConnectedComponent) -> None:
        executor, hooks = self._bus.executor, self._hooks
        for stage in executor.pipeline.stages:
            if stage.hook(hook) is not None:
                hooks.do(partial(executor.call, stage, hook, component, worker=hooks))
