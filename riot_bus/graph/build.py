"""Construction of a graph from observations; pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.graph.model import CALL_ROLES, ConnectedComponent, Edge, Graph, Topic, Unknown
from riot_bus.types.capabilities import Announcement
from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from riot_bus.graph.observations import Observations
    from riot_bus.types.capabilities import Role
    from riot_bus.types.port import BridgedLink

_ONLY = "only component"
_BRIDGE = "bridge"
_UNTOLD = Announcement("", None, "", "", "", "", "")


def build(seen: Observations) -> Graph:
    """Return the graph that the observations support, and what they leave open."""
    return _Builder(seen).graph()


class _Builder:
    def __init__(self, seen: Observations) -> None:
        self.seen = seen
        self.edges: dict[tuple[str, str, str, str, str], Edge] = {}
        self.index: defaultdict[tuple[str, Role, str], set[tuple[str, str, str, str, str]]] = defaultdict(set)
        self.unknown: list[Unknown] = []
        self.segments_of: defaultdict[str, list[str]] = defaultdict(list)
        self.members: defaultdict[str, list[str]] = defaultdict(list)
        for segment, zid in sorted(seen.sessions):
            self.segments_of[zid].append(segment)
            self.members[segment].append(zid)

    def graph(self) -> Graph:
        self.announced()
        self.expand()
        self.bridged()
        self.traffic()
        self.receivers()
        self.silent()
        if self.seen.skipped:
            self.unknown.append(Unknown("", "", f"who would receive {self.seen.skipped} more keys: too many to watch"))
        if self.seen.left_out:
            self.unknown.append(Unknown("", "", f"more keys than the busiest {len(self.seen.flows)}: too many to show"))
        return Graph.of(self.components(), self.topics(), self.edges.values(), self.unknown)

    def add(self, edge: Edge) -> None:
        former = self.edges.get(edge.identity)
        if former is not None:
            evidence = {*former.evidence, *edge.evidence}
            edge = replace(
                edge,
                evidence=tuple(sorted(evidence)),
                messages=max(former.messages, edge.messages),
                rate=max(former.rate, edge.rate),
            )
        self.edges[edge.identity] = edge
        self.index[edge.topic, edge.role, edge.segment].add(edge.identity)

    def announced(self) -> None:
        for token in self.seen.tokens:
            if token.role is not None:
                for segment in self.segments_of.get(token.zid, [""]):
                    self.add(Edge(token.key, token.role, segment, token.zid, token.node, (token.source,)))

    def known(self, key: str, role: Role, segment: str, zid: str | None = None) -> list[Edge]:
        found = (self.edges[identity] for identity in sorted(self.index.get((key, role, segment), ())))
        return [edge for edge in found if zid in (None, edge.zid)]

    def expand(self) -> None:
        """Give each topic the edges of the key expressions that include it."""
        keys = {key for key, _ in self.seen.flows} | {edge.topic for edge in self.edges.values()}
        plain = [key for key in keys if "*" not in key]
        for edge in [edge for edge in self.edges.values() if "*" in edge.topic]:
            for key in plain:
                if key_matches(edge.topic, key) and not self.known(key, edge.role, edge.segment, edge.zid):
                    self.add(replace(edge, topic=key))

    def bridged(self) -> None:
        """Add the edges of bridge links: each publishes what came over it, and subscribes to other keys it takes."""
        keys = {key for key, _ in self.seen.flows} | {key for each in self.seen.bridged for key in each.publishes}
        keys |= {edge.topic for edge in self.edges.values() if edge.role == "publishes"}
        for each in self.seen.bridged:
            who = _id_of(each)
            for key, node in each.publishes.items():
                self.add(Edge(key, "publishes", each.segment, who, node, (_BRIDGE,)))
            for key in keys - each.publishes.keys() if each.subscribes else ():
                if key_matches(each.subscribes, key):
                    self.add(Edge(key, "subscribes", each.segment, who, evidence=(_BRIDGE,)))

    def traffic(self) -> None:
        for (key, segment), count in sorted(self.seen.flows.items()):
            edge = Edge(key, "publishes", segment, evidence=("traffic",), messages=count)
            edge = replace(edge, rate=self.seen.rates.get((key, segment), 0.0))
            members = self.members.get(segment, [])
            stamped = sorted(set(self.seen.senders.get((key, segment), ())) & set(members))
            declared = self.known(key, "publishes", segment)
            if stamped:
                for zid in stamped:
                    node = next((each.node for each in declared if each.zid == zid), "")
                    alone = edge if len(stamped) == 1 else replace(edge, messages=0, rate=0.0)
                    self.add(replace(alone, zid=zid, node=node, evidence=("timestamp", "traffic")))
            elif len(declared) == 1:
                self.add(replace(edge, zid=declared[0].zid, node=declared[0].node))
            elif not declared and len(members) == 1:
                self.add(replace(edge, zid=members[0], evidence=(_ONLY, "traffic")))
            else:
                self.add(edge)
                who = f"{len(declared)} components declare it" if declared else _nobody(members)
                self.unknown.append(Unknown(key, segment, f"unknown source in segment {segment}: {who}"))

    def receivers(self) -> None:
        elsewhere: set[str] = set()
        for segment, key in sorted(self.seen.matching):
            if not self.seen.intercepted(key) and len(self.seen.segments) > 1:
                elsewhere.add(key)
                continue
            if self.known(key, "subscribes", segment):
                continue
            members = self.members.get(segment, [])
            if len(members) == 1:
                self.add(Edge(key, "subscribes", segment, members[0], evidence=("matching", _ONLY)))
            else:
                self.add(Edge(key, "subscribes", segment, evidence=("matching",)))
                text = f"unknown receiver in segment {segment}: {_nobody(members)}"
                self.unknown.append(Unknown(key, segment, text))
        for key in sorted(elsewhere):
            if not any(edge.topic == key and edge.role == "subscribes" for edge in self.edges.values()):
                self.add(Edge(key, "subscribes", evidence=("matching",)))
                text = "unknown receiver: which segment shows only for intercepted keys"
                self.unknown.append(Unknown(key, "", text))

    def silent(self) -> None:
        speaking = {token.zid for token in self.seen.tokens}
        text = "announces nothing: what it publishes and subscribes to shows only by traffic and matching"
        self.unknown += [Unknown(z, s, text) for s, z in self.seen.sessions if z not in speaking]

    def components(self) -> list[ConnectedComponent]:
        """Return the programs: connected sessions, links of bridges, and sessions that only announce themselves."""
        nodes: defaultdict[str, set[str]] = defaultdict(set)
        for token in self.seen.tokens:
            nodes[token.zid].update(filter(None, [token.node]))
        result = []
        for (segment, zid), mode in self.seen.sessions.items():
            addresses = tuple(sorted(self.seen.addresses.get((segment, zid), ())))
            owner = next((self.seen.owners[each] for each in addresses if each in self.seen.owners), None)
            one = ConnectedComponent(
                segment, zid, mode, self.seen.names.get(zid, ""), tuple(sorted(nodes[zid])), addresses
            )
            result.append(replace(one, pid=owner.pid, command=owner.command) if owner else one)
        for each in self.seen.bridged:
            spoken = tuple(sorted(set(each.publishes.values())))
            result.append(ConnectedComponent(each.segment, _id_of(each), "link", each.name, spoken, each.addresses))
        for zid in sorted({token.zid for token in self.seen.tokens} - self.segments_of.keys()):
            result.append(ConnectedComponent("", zid, "", self.seen.names.get(zid, ""), tuple(sorted(nodes[zid]))))
            self.unknown.append(Unknown(zid, "", "announces itself, but is connected to no segment: what is between?"))
        return result

    def topics(self) -> list[Topic]:
        told: dict[str, Announcement] = {}
        for token in sorted(self.seen.tokens, key=lambda each: (each.type_name, each.topic, each.key)):
            told[token.key] = token
        asked = {edge.topic for edge in self.edges.values() if edge.role in CALL_ROLES}
        spoken = {edge.topic for edge in self.edges.values() if edge.role not in CALL_ROLES}
        result = []
        for key in asked | spoken:
            token = told.get(key, _UNTOLD)
            name = self.seen.name(key)
            name = token.topic if token.topic and name == key else name
            intercepted = (key in spoken and self.seen.intercepted(key)) or (
                key in asked and self.seen.calls_intercepted(key)
            )
            intercepted = intercepted and "*" not in key
            result.append(Topic(key, name, token.type_name, intercepted, token.action, token.action_type))
        return result


def _id_of(link: BridgedLink) -> str:
    return f"{link.segment}/{link.name}"


def _nobody(members: list[str]) -> str:
    return f"none of {len(members)} components declares it" if members else "it has no components"
