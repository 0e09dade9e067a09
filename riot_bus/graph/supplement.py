"""A graph with what a recording adds to it: who publishes, as far as messages tell; pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from riot_bus.graph.build import build
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic
from riot_bus.graph.observations import Observations
from riot_bus.types.capabilities import Announcement

_BY_MATCHING = frozenset({"matching", "only component"})


def supplemented(
    graph: Graph,
    counts: Mapping[tuple[str, str], int],
    *,
    senders: Mapping[str, Collection[str]] | None = None,
    tokens: Iterable[Announcement] = (),
    complete: bool = True,
) -> Graph:
    """Return a graph with the keys of a recording, and with their publishers where these can be determined.

    Args:
        graph: Graph of the connected components, and what is known about them.
        counts: Messages by key and source segment; the segment is empty if the recording does not state it.
        senders: Ids in the timestamps of messages, by key.
        tokens: Announcements of components.
        complete: Whether the graph has all components; else messages are not attributed to the only segment.
    """
    homes = {each.zid: each.segment for each in graph.components}
    segments = sorted({each.segment for each in graph.components})
    flows: dict[tuple[str, str], int] = {}
    stamps: dict[tuple[str, str], set[str]] = {}
    for (key, told), count in counts.items():
        known = {zid for zid in (senders or {}).get(key, ()) if zid in homes}
        places = [told] if told and told in segments else sorted({homes[zid] for zid in known})
        if not places and complete and len(segments) == 1:
            places = segments
        for place in places:
            flows[key, place] = count if len(places) == 1 else 0
            stamps[key, place] = {zid for zid in known if homes[zid] == place}
    sessions = {(each.segment, each.zid): each.mode for each in graph.components}
    more = build(Observations(tuple(segments), sessions, tokens=set(tokens), flows=flows, senders=stamps))
    return _joined(graph, more, {key for key, _ in counts})


def without_listener(graph: Graph) -> tuple[Graph, bool]:
    """Return a graph without edges that rest on matching in segments where something reads everything.

    There each key has a receiver, even those that the component publishes: this is how a recorder of `**` shows, and it
    says nothing about the component. Also returns whether there is such a segment.
    """
    read: defaultdict[str, set[str]] = defaultdict(set)
    written: defaultdict[str, set[str]] = defaultdict(set)
    for edge in graph.edges:
        if "matching" in edge.evidence and edge.zid:
            read[edge.segment].add(edge.topic)
        elif edge.role == "publishes":
            written[edge.segment].add(edge.topic)
    every = set().union(*read.values(), *written.values())
    listened = {segment for segment, keys in read.items() if keys >= every and len(every) > 1 and written[segment]}
    kept = [e for e in graph.edges if e.segment not in listened or not _BY_MATCHING.issuperset(e.evidence)]
    return replace(graph, edges=tuple(kept)), bool(listened)


def _joined(graph: Graph, more: Graph, keys: Collection[str]) -> Graph:
    """Return the edges, topics and components of both graphs, with what is unknown in the first."""
    edges: dict[tuple[str, str, str, str, str], Edge] = {each.identity: each for each in graph.edges}
    for edge in more.edges:
        known = edges.get(edge.identity)
        evidence = {*edge.evidence, *(known.evidence if known is not None else ())}
        edges[edge.identity] = replace(edge, evidence=tuple(sorted(evidence)))
    told = {(each.topic, each.role, each.segment) for each in edges.values() if each.zid}
    kept = [each for each in edges.values() if each.zid or (each.topic, each.role, each.segment) not in told]
    topics = {each.key: each for each in (*more.topics, *graph.topics)}
    topics |= {key: Topic(key, key) for key in keys if key not in topics}
    components: Iterable[ConnectedComponent] = {
        (each.segment, each.zid): each for each in (*more.components, *graph.components)
    }.values()
    return Graph.of(components, topics.values(), kept, graph.unknown)
