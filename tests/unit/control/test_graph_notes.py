from __future__ import annotations

from collections.abc import Mapping

from riot_bus.control.graph_notes import GraphNotes
from riot_bus.graph.model import ConnectedComponent, Graph
from riot_bus.log.layout import GRAPH

ONE = Graph(components=(ConnectedComponent("a", "01"),))
TWO = Graph(components=(ConnectedComponent("a", "01"), ConnectedComponent("b", "02")))


class Log:
    """Keeps the records that are written while it is open."""

    def __init__(self) -> None:
        self.open = False
        self.records: list[Mapping[str, str]] = []

    def write(self, name: str, mapping: Mapping[str, str]) -> bool:
        assert name == GRAPH
        if self.open:
            self.records.append(mapping)
        return self.open


def test_a_log_begins_with_the_whole_graph_and_goes_on_with_changes() -> None:
    log = Log()
    notes = GraphNotes(log.write)
    assert notes.whole() == []
    notes.update(ONE)
    with notes.new_log():
        log.open = True
    notes.update(ONE)
    assert len(log.records) == 1
    notes.update(TWO)
    assert len(log.records) == 2
    with notes.new_log():
        assert len(log.records) == 2
    assert len(log.records) == 3
    ((_, whole),) = notes.whole()
    assert {**whole, "time": ""} == {**log.records[2], "time": ""}
