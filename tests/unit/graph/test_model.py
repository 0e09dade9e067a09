from __future__ import annotations

from dataclasses import replace
from itertools import permutations

from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic, Unknown

PUBLISHES = Edge("k", "publishes", "in", "aa", evidence=("traffic",), messages=5, rate=2.0)
READS = Edge("k", "subscribes")
FULL = Graph.of(
    [ConnectedComponent("in", "aa", name="talker"), ConnectedComponent("", "bb")],
    [Topic("k", "/k"), Topic("j", "/j")],
    [PUBLISHES, READS],
    [Unknown("", "", "all"), Unknown("k", "in", "who reads"), Unknown("", "", "all")],
)


def changes(after: Graph, before: Graph) -> list[tuple[str, str, str]]:
    return [(each.what, each.kind, each.subject) for each in after.changes_since(before)]


def test_equal_networks_give_equal_graphs_in_any_order() -> None:
    for components in permutations(FULL.components):
        for topics in permutations(FULL.topics):
            assert Graph.of(components, topics, reversed(FULL.edges), reversed(FULL.unknown)) == FULL
    assert len(FULL.unknown) == 2


def test_counts_and_rates_are_no_change() -> None:
    later = replace(FULL, edges=tuple(replace(each, messages=99, rate=9.0) for each in FULL.edges))
    assert later == FULL
    assert changes(later, FULL) == []


def test_changes_name_what_appeared_vanished_and_changed() -> None:
    assert changes(FULL, Graph()) == [
        ("component", "appeared", "aa in in"),
        ("component", "appeared", "bb in no segment"),
        ("edge", "appeared", "aa in in publishes k"),
        ("edge", "appeared", "an unknown component in an unknown segment subscribes k"),
        ("topic", "appeared", "j"),
        ("topic", "appeared", "k"),
        ("unknown", "appeared", "all"),
        ("unknown", "appeared", "k: in: who reads"),
    ]
    assert {kind for _, kind, _ in changes(Graph(), FULL)} == {"vanished"}
    after = replace(
        FULL,
        edges=(replace(PUBLISHES, evidence=("timestamp", "traffic")), replace(READS, node="/nav")),
        topics=(Topic("k", "/k", intercepted=True),),
    )
    assert changes(after, FULL) == [
        ("edge", "appeared", "an unknown component (/nav) in an unknown segment subscribes k"),
        ("edge", "changed", "aa in in publishes k"),
        ("edge", "vanished", "an unknown component in an unknown segment subscribes k"),
        ("topic", "changed", "k"),
        ("topic", "vanished", "j"),
    ]


def test_a_component_is_found_in_any_segment_or_in_one() -> None:
    found = FULL.component("aa")
    assert found is not None
    assert found.name == "talker"
    assert FULL.component("aa", "in") == found
    assert FULL.component("aa", "") is None
    assert FULL.component("bb", "") is not None
    assert FULL.component("cc") is None


def test_people_call_a_component_by_the_best_that_is_known() -> None:
    all_known = ConnectedComponent("in", "0123456789", name="n", nodes=("/a", "/b"), command="c")
    assert all_known.label == "n"
    assert replace(all_known, name="").label == "/a, /b"
    assert replace(all_known, name="", nodes=()).label == "c"
    assert replace(all_known, name="", nodes=(), command="").label == "01234567"
