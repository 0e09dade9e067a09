from __future__ import annotations

import pytest

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus_fleet.evidence.recorded_graph import loops, tree_once
from tests.unit.backchain.recordings import text_of


@pytest.fixture
def graph():
    return TopicGraph(
        {
            "planner": ComponentTopics(frozenset({"goal", "odom", "map"}), frozenset({"cmd", "plan"})),
            "base": ComponentTopics(frozenset({"cmd"}), frozenset({"odom"})),
            "mapper": ComponentTopics(frozenset({"scan", "odom"}), frozenset({"map"})),
            "logger": ComponentTopics(frozenset({"plan", "battery"}), frozenset({"log"})),
        }
    )


def test_each_topic_is_followed_at_one_place_if_asked_so(graph):
    tree = tree_once(graph, "plan", {"goal", "scan", "cmd"})
    assert text_of(tree).splitlines() == [
        "plan",
        "  goal via planner [external]",
        "  map via planner",
        "    odom via mapper [again]",
        "    scan via mapper [external]",
        "  odom via planner",
        "    cmd via base [external]",
    ]
    loop = tree_once(graph, "odom", {"goal"})
    assert "odom via planner [loop]" in text_of(loop)


def test_a_way_without_end_is_cut():
    steps = {f"c{at}": ComponentTopics(frozenset({f"t{at + 1}"}), frozenset({f"t{at}"})) for at in range(300)}
    text = text_of(tree_once(TopicGraph(steps), "t0", {"t300"}))
    assert text.splitlines()[-1].endswith("t201 via c200 [cut]")


def test_loops_are_sets_of_topics_that_lead_back(graph):
    assert loops(graph) == [("cmd", "map", "odom")]
    assert loops(TopicGraph({"echo": ComponentTopics(frozenset({"a"}), frozenset({"a", "b"}))})) == [("a",)]
    assert loops(TopicGraph()) == []
