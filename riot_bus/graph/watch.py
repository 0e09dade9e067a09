"""Keeps the graph of a bus up to date and calls back on each change."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Collection, Mapping
from typing import Self

from riot_bus.graph.build import build
from riot_bus.graph.model import Graph, GraphChange
from riot_bus.graph.observe import Observer, WatchedBus
from riot_bus.types.registry import TypeRegistry

_LOG = logging.getLogger(__name__)
_LEAST_S = 0.02
_REST = 19
"""The watch rests this many times as long as a refresh took, because bus traffic shares the processor."""


class GraphWatch:
    """The present graph of a bus; a context manager.

    Events of Zenoh (sessions, links, announcements) are processed at once; whatever has no events (traffic, who would
    receive) is polled once per period. Read-only: it asks routers nothing that could hang them (see `graph.sources`).

    Args:
        callback: Called with each new graph and what changed, one call at a time; what it raises is logged.
        senders: Returns the ids that stamped messages, by key and source segment. A component stamps its messages if
            its configuration says `timestamping/enabled`; each stamp holds its id.
        period: Polling period in seconds.
    """

    def __init__(
        self,
        bus: WatchedBus,
        callback: Callable[[Graph, tuple[GraphChange, ...]], None] | None = None,
        *,
        senders: Callable[[], Mapping[tuple[str, str], Collection[str]]] = dict,
        registry: TypeRegistry | None = None,
        period: float = 1.0,
    ) -> None:
        self._callback = callback
        self._period = period
        self._wake = threading.Event()
        self._observer = Observer(
            bus, self._wake.set, senders=senders, registry=registry or TypeRegistry(), processes=True
        )
        self._graph, self._looked = Graph(), -math.inf
        self._new = threading.Condition()
        self._updating = threading.RLock()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> Self:
        """Read the present state, then follow the changes."""
        self._observer.start()
        self.refresh()
        self._thread = threading.Thread(target=self._run, name="riot-graph", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Stop; the last graph stays. Call it before the bus is closed; safe to call twice."""
        self._stopping.set()
        self._wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self._observer.stop()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *error: object) -> None:
        self.stop()

    @property
    def graph(self) -> Graph:
        """The present graph."""
        return self._graph

    @property
    def age(self) -> float:
        """Seconds since the look that the present graph describes; infinite before the first."""
        return time.monotonic() - self._looked

    def refresh(self) -> Graph:
        """Look at everything now and return the graph."""
        with self._updating:
            looked = time.monotonic()
            graph = build(self._observer.observe())
            changes = graph.changes_since(self._graph)
            with self._new:
                self._graph, self._looked = graph, looked
                self._new.notify_all()
            if changes and self._callback is not None:
                try:
                    self._callback(graph, changes)
                except Exception:
                    _LOG.exception("what listens to changes of the graph failed")
        return graph

    def wait(self, condition: Callable[[Graph], bool], timeout: float) -> bool:
        """Wait until the graph satisfies a condition; return whether it did in time."""
        with self._new:
            return self._new.wait_for(lambda: condition(self._graph), timeout)

    def _run(self) -> None:
        rest = _LEAST_S  # at least: a system that starts announces a thousand things at once
        while not self._stopping.wait(rest):
            self._wake.wait(self._period)
            self._wake.clear()
            if self._stopping.is_set():
                return
            began = time.monotonic()
            try:
                self.refresh()
            except Exception:
                if not self._stopping.is_set():
                    _LOG.exception("the graph could not be brought up to date")
            rest = min(max(_LEAST_S, _REST * (time.monotonic() - began)), 30.0)
