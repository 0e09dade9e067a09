"""Graphs over time as records for a log: the first is complete, each later one says what is new and what is gone."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, fields
from typing import Any

from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic, Unknown
from riot_bus.graph.render import VERSION

_PARTS: dict[str, type[Any]] = {"components": ConnectedComponent, "topics": Topic, "edges": Edge, "unknown": Unknown}


def record(before: Graph | None, after: Graph, *, time: int) -> dict[str, str]:
    """Return the changes of a graph, as the mapping of a metadata record."""
    parts = {
        "gone": {} if before is None else _missing(before, after),
        "new": _missing(after, before or Graph()),
    }
    texts = {name: json.dumps({"version": VERSION, **part}, sort_keys=True) for name, part in parts.items()}
    return {"time": str(time), "whole": "true" if before is None else "false", **texts}


def replay(records: Iterable[Mapping[str, str]]) -> Iterator[tuple[int, Graph]]:
    """Yield each graph and its time from the records of a log.

    Raises:
        ValueError: A record is damaged.
    """
    graph = Graph()
    for each in records:
        try:
            time, whole = int(each["time"]), each["whole"] == "true"
            gone, new = graph_from(json.loads(each["gone"])), graph_from(json.loads(each["new"]))
            base = Graph() if whole else graph
            left = {name: set(getattr(base, name)) - set(getattr(gone, name)) for name in _PARTS}
            graph = Graph.of(*([*left[name], *getattr(new, name)] for name in _PARTS))
        except (KeyError, TypeError, RecursionError) as error:  # such as a value that cannot be in a set, or be sorted
            raise ValueError(f"not a record of a graph: {error!r}") from error
        yield time, graph


def graph_from(document: Mapping[str, Any]) -> Graph:
    """Return the graph of a document in the JSON format; raises TypeError or ValueError if it is none."""
    if not isinstance(document, Mapping):
        raise TypeError(f"a graph is an object, not {document!r:.50}")
    if document.get("version") != VERSION:
        raise ValueError(f"the graph has version {document.get('version')!r}; only version {VERSION} can be read")
    parts: dict[str, list[Any]] = {}
    for name, kind in _PARTS.items():
        known = {each.name for each in fields(kind)}
        parts[name] = [
            kind(**{key: _frozen(value) for key, value in row.items() if key in known})
            for row in map(_object, document.get(name, ()))
        ]
    return Graph.of(parts["components"], parts["topics"], parts["edges"], parts["unknown"])


def _object(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"a part of a graph is an object, not {value!r:.50}")
    return value


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _missing(graph: Graph, other: Graph) -> dict[str, list[dict[str, Any]]]:
    """Return the parts of a graph that the other does not have."""
    known = {name: set(getattr(other, name)) for name in _PARTS}
    return {name: [asdict(each) for each in getattr(graph, name) if each not in known[name]] for name in _PARTS}
