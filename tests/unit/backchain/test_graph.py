from __future__ import annotations

import json

import pytest

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
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


def test_reaching_and_reached(graph):
    assert graph.reaching("map") == {"map", "scan", "odom", "cmd", "goal"}
    assert graph.reached("battery") == {"battery", "log"}
    assert graph.reaching("unknown") == {"unknown"}


def test_backtrack_tree_ends_at_externals_and_cuts_loops(graph):
    tree = graph.backtrack_tree("map", {"goal", "scan", "battery"})
    text = text_of(tree)
    assert "goal via planner [external]" in text
    assert "scan via mapper [external]" in text
    assert "battery" not in text
    assert "map via planner [loop]" in text
    assert "odom via planner [loop]" in text
    assert json.loads(json.dumps(tree.as_json()))["topic"] == "map"


def test_branches_without_external_are_left_out(graph):
    assert graph.backtrack_tree("map", {"battery"}).hops == ()
    assert graph.backtrack_tree("map", set()).hops == ()


def test_large_trees_are_cut_and_say_so():
    topics = frozenset(f"t{at}" for at in range(9))
    dense = TopicGraph({"all": ComponentTopics(topics | {"in"}, topics)})
    tree = dense.backtrack_tree("t0", {"in"}, most=500)
    text = text_of(tree)
    assert "cut" in text
    assert len(text.splitlines()) <= 500


def test_a_tree_of_one_topic_is_cut_at_its_root(graph):
    tree = graph.backtrack_tree("map", {"goal"}, most=1)
    assert tree.cut
    assert tree.hops == ()
    assert text_of(tree) == "map [cut]"


def test_writers_are_found_by_topic(graph):
    assert list(graph.writers("plan")) == ["planner"]
    assert graph.writers("goal") == {}
