"""Notes of the graph in a log: the whole graph first, then what has changed."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from riot_bus.graph.model import Graph


class GraphNotes:
    """Notes of the graph in the present log; thread-safe.

    Args:
        write: Function that writes a metadata record to the log, and returns whether there is one.
    """

    def __init__(self, write: Callable[[str, Mapping[str, str]], bool]) -> None:
        self._write = write
        self._lock = threading.Lock()
        self._graph: Graph | None = None
        self._noted: Graph | None = None

    def update(self, graph: Graph, _: object = None) -> None:
        """Write what has changed in the graph since it was last written to the log."""
        with self._lock:
            self._graph = graph
            self._note()

    @contextmanager
    def new_log(self) -> Iterator[None]:
        """Write the whole graph to the log that is begun inside the block."""
        with self._lock:
            yield
            self._noted = None
            self._note()

    def whole(self) -> list[tuple[str, Mapping[str, str]]]:
        """Return the record of the whole graph; none if there is no graph."""
        return [] if self._graph is None else [_entry(None, self._graph)]

    def _note(self) -> None:
        graph = self._graph
        if graph is None or graph == self._noted:
            return
        if self._write(*_entry(self._noted, graph)):
            self._noted = graph


def _entry(before: Graph | None, graph: Graph) -> tuple[str, Mapping[str, str]]:
    from riot_bus.graph.history import record
    from riot_bus.log.layout import GRAPH

    return GRAPH, record(before, graph, time=time.time_ns())
