"""Paths from an internal field back to external topics, by logs alone, and the evidence for each (RIOT II-C).

The topic graph gives the paths; unknown writers and inputs are inferred from what the topic's fields follow.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from riot_bus.backchain.graph import ComponentTopics, Hop, TopicGraph
from riot_bus.vocabulary.trial import Progress
from riot_bus_fleet.evidence.alignment import Piece, Variants, held_variants, response_of, topic_of
from riot_bus_fleet.evidence.dependence import ALPHA, Dependence, dependences
from riot_bus_fleet.evidence.recorded_graph import loops, tree_once

INFERRED = "inferred"

_MOST_RESPONSES = 40
_FEW = 3
"""Fields of a topic that are tested if none was found to matter: those that change most."""


@dataclass(frozen=True, slots=True)
class FieldEvidence:
    """Evidence from the logs on whether one field follows another."""

    source: str
    target: str
    rows: int = 0
    logs: int = 0
    dependence: Dependence | None = None
    reason: str = ""

    @property
    def found(self) -> bool:
        """Whether the target follows the source in these logs."""
        return self.dependence is not None and self.dependence.found

    @property
    def level(self) -> bool:
        """Whether the target's value follows, not only how much it varies, as with shared times of activity."""
        return self.found and self.dependence is not None and self.dependence.follows == "level"


@dataclass(frozen=True, slots=True)
class TopicEdge:
    """A topic that components read to write another one, or seem to.

    Attributes:
        source: The topic that is read; empty if all topics were tried and none seems to be read.
    """

    source: str
    target: str
    components: tuple[str, ...]
    told: tuple[str, ...]
    evidence: tuple[FieldEvidence, ...] = ()


@dataclass(slots=True)
class Backtracked:
    """Paths from some fields of the system back to external topics.

    Attributes:
        targets: The requested fields, each with why it cannot be judged (empty if it can).
        unreachable: External topics from which no path of the graph leads to a target.
        unwritten: Topics on a path that have no known writer, though not external.
        missing: Topics on a path without a message in any log.
        loops: Sets of topics on a path that lead back to themselves.
        alpha: Accepted chance of any wrong source per field whose sources were tested.
    """

    targets: dict[str, str]
    trees: list[Hop] = field(default_factory=list)
    edges: list[TopicEdge] = field(default_factory=list)
    externals: dict[str, str] = field(default_factory=dict)
    ranking: list[FieldEvidence] = field(default_factory=list)
    unreachable: list[str] = field(default_factory=list)
    unwritten: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    loops: list[tuple[str, ...]] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)
    alpha: float = ALPHA
    tested: int = 0


def backtrack(
    pieces: Sequence[Piece],
    graph: TopicGraph,
    targets: Sequence[str],
    *,
    externals: Mapping[str, str],
    recorded: Collection[str] = (),
    horizon: float = 2.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Backtracked:
    """Find the paths from internal fields back to external topics.

    Args:
        externals: External topics, and who says so; if empty, topics to which nothing recorded leads are taken.
        recorded: Topics of the logs that have no numeric field; those of `pieces` need not be named.
        horizon: Longest delay of one step that is tested, in seconds.
    """
    tests = _PairTests(pieces, recorded, horizon=horizon, seed=seed)
    traversal = _Traversal(tests, graph, externals, progress)
    result = Backtracked(dict.fromkeys(targets, ""), alpha=ALPHA)
    for name in targets:
        found = response_of(pieces, name)
        result.targets[name] = found if isinstance(found, str) else ""
    traversal.follow(targets)
    graph = traversal.graph
    result.externals = dict(externals) or traversal.ends
    roots = list(dict.fromkeys(map(topic_of, targets)))
    ends = {*result.externals, *traversal.ends, *traversal.blind}
    result.trees = [tree_once(graph, topic, ends) for topic in roots]
    around = frozenset().union(*(graph.reaching(topic) for topic in roots))
    # If something had to be guessed, there may be a path even if none is known.
    asked = set(result.externals) if traversal.guessed else set(result.externals) & around
    result.unreachable = sorted(set(result.externals) - asked)
    outside = sorted(asked & set(tests.fields))
    result.ranking = _ranked(
        one
        for name in targets
        for one in tests.at(name, [each for at in outside if at != topic_of(name) for each in tests.fields[at]])
    )
    result.edges = traversal.edges()
    result.unwritten = sorted(traversal.unwritten)
    result.missing = sorted((around & (traversal.seen | set(result.externals))) - set(tests.fields))
    result.loops = [one for one in loops(graph) if set(one) & traversal.seen]
    result.unseen = traversal.unseen
    result.tested = tests.tested
    return result


def _ranked(found: Iterable[FieldEvidence]) -> list[FieldEvidence]:
    def order(one: FieldEvidence) -> tuple[int, float, float, str]:
        told = one.dependence
        if told is None:
            return 3, 0.0, 0.0, one.source
        return (0 if one.level else 1 if one.found else 2), -(told.strength or 0.0), told.p_value, one.source

    return sorted(found, key=order)


class _PairTests:
    """Tests fields against fields, each pair once."""

    def __init__(self, pieces: Sequence[Piece], recorded: Collection[str], *, horizon: float, seed: int) -> None:
        self.pieces = pieces
        self.tested = 0
        self._test = partial(dependences, horizon=horizon, seed=seed)
        topics = sorted({*recorded, *(topic for piece in pieces for topic in piece.times)})
        self.fields: dict[str, list[str]] = {topic: [] for topic in topics}
        for name in sorted({name for piece in pieces for name in piece.values}):
            self.fields[topic_of(name)].append(name)

    def at(self, target: str, names: Sequence[str]) -> list[FieldEvidence]:
        """Return the evidence that a field follows each of some others, given each other."""
        response = response_of(self.pieces, target)
        if isinstance(response, str):
            return [FieldEvidence(name, target, reason=f"{target}: {response}") for name in names]
        usable: dict[str, Variants] = {}
        result = []
        for name in names:
            variants = held_variants(self.pieces, name, response)
            if isinstance(variants, str):
                result.append(FieldEvidence(name, target, reason=variants))
            else:
                usable[name] = variants
        found = self._test(response, usable)
        self.tested += len(usable)
        told = [FieldEvidence(one.name, target, usable[one.name].rows, usable[one.name].logs, one) for one in found]
        return told + result

    def liveliest(self, topic: str) -> list[str]:
        """Return the few fields of a topic that change most."""
        counts = {}
        for name in self.fields.get(topic, ()):
            values = [piece.values[name] for piece in self.pieces if name in piece.values]
            counts[name] = sum(int(np.count_nonzero(np.diff(one))) for one in values)
        alive = [name for name in sorted(counts, key=lambda name: (-counts[name], name)) if counts[name]]
        return alive[:_FEW]


class _Traversal:
    """Goes back from topic to topic."""

    def __init__(
        self, tests: _PairTests, graph: TopicGraph, externals: Mapping[str, str], progress: Progress | None
    ) -> None:
        self.tests, self.graph, self.externals, self.progress = tests, graph, externals, progress
        self.ends: dict[str, str] = {}
        self.blind: set[str] = set()
        self.unwritten: set[str] = set()
        self.unseen: list[str] = []
        self.seen: set[str] = set()
        self._evidence: defaultdict[tuple[str, str], list[FieldEvidence]] = defaultdict(list)
        self._inferred: set[tuple[str, str]] = set()
        self.guessed = False
        self._roots: frozenset[str] = frozenset()
        self._done = 0

    def follow(self, targets: Sequence[str]) -> None:
        """Go back from the topics of these fields until only ends are left."""
        asked: dict[str, list[str]] = defaultdict(list)
        for name in targets:
            asked[topic_of(name)].append(name)
        ahead = list(asked)
        self._roots = frozenset(ahead)
        self.seen = set(ahead)
        for topic in ahead:  # grows
            if topic in self.externals and topic not in self._roots:
                continue
            matters = self._step_back(topic, asked.get(topic) or self.tests.liveliest(topic))
            for source, fields in sorted(matters.items()):
                if source not in self.seen:
                    self.seen.add(source)
                    ahead.append(source)
                    asked[source] = fields
                elif source in ahead[ahead.index(topic) + 1 :]:
                    asked[source] = list(dict.fromkeys([*asked[source], *fields]))

    def _step_back(self, topic: str, responses: Sequence[str]) -> dict[str, list[str]]:
        """Test a topic's fields against what may lead to it; return topics before it, and their fields that matter."""
        writers = self.graph.writers(topic)
        known = frozenset().union(*(one.inputs for one in writers.values())) - {topic}
        guess = not writers or any(one.open for one in writers.values())
        others = set(self.tests.fields) - {topic} if guess else known & set(self.tests.fields)
        names = [name for other in sorted(others) for name in self.tests.fields[other]]
        found: list[FieldEvidence] = []
        for response in responses:
            if self._done >= _MOST_RESPONSES:
                self.unseen.append(response)
                continue
            found += self.tests.at(response, names)
            self._done += 1
            if self.progress is not None:
                self.progress(self._done, None, f"what {response} follows")
        inferred = {topic_of(one.source) for one in found if one.level} - known if guess else set()
        if not writers:
            self.unwritten.add(topic)
        if inferred:
            self._infer(topic, writers, inferred)
        before = known | inferred
        self.guessed = self.guessed or guess
        for one in found:
            source = topic_of(one.source)
            if source in before:
                self._evidence[source, topic].append(one)
            elif not before:
                self._evidence["", topic].append(one)
        if not before and topic not in self._roots:
            if topic in self.tests.fields:
                self.ends[topic] = "nothing recorded leads to it" if guess else f"{', '.join(writers)} reads nothing"
            else:
                self.blind.add(topic)
        return {
            source: list(dict.fromkeys(one.source for one in found if one.found and topic_of(one.source) == source))
            for source in before
        }

    def _infer(self, topic: str, writers: Mapping[str, ComponentTopics], sources: Collection[str]) -> None:
        components = dict(self.graph.components)
        for name, one in writers.items():
            if one.open:
                components[name] = replace(one, inputs=one.inputs | frozenset(sources))
        if not writers:
            name = f"unknown writer of {topic}"
            components[name] = ComponentTopics(frozenset(sources), frozenset({topic}), INFERRED, open=True)
        self.graph = TopicGraph(components)
        self._inferred |= {(source, topic) for source in sources}

    def edges(self) -> list[TopicEdge]:
        """Return the tested steps, ordered by their topics."""
        result = []
        for target in sorted(self.seen):
            if target in self.externals and not any(pair[1] == target for pair in self._evidence):
                continue
            writers = self.graph.writers(target)
            if self._evidence.get(("", target)):
                result.append(TopicEdge("", target, (), (INFERRED,), tuple(_ranked(self._evidence["", target]))))
            for source in sorted(frozenset().union(*(one.inputs for one in writers.values())) - {target}):
                by = {name: one for name, one in writers.items() if source in one.inputs}
                told = {INFERRED} if (source, target) in self._inferred else {one.told for one in by.values()}
                evidence = tuple(_ranked(self._evidence[source, target]))
                result.append(TopicEdge(source, target, tuple(by), tuple(sorted(told)), evidence))
        return result
