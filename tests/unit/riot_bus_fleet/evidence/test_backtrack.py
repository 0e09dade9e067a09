from __future__ import annotations

import numpy as np

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus_fleet.evidence.backtrack import INFERRED, backtrack
from tests.unit.backchain.recordings import late, pieces, red, text_of


def chain(rng, count):
    goal, odom, noise = red(rng, count, 0.9), red(rng, count, 0.5), red(rng, count, 0.5)
    middle = late(goal, 1) + 0.4 * noise
    return {
        "goal": goal,
        "odom": odom,
        "joy": red(rng, count, 0.3),
        "log": late(goal, 1) + 0.4 * red(rng, count),
        "map": middle,
        "out": late(middle, 1) + 0.5 * late(odom, 2) + 0.3 * red(rng, count, 0.2),
    }


KNOWN = TopicGraph(
    {
        "mapper": ComponentTopics(frozenset({"goal"}), frozenset({"map"})),
        "planner": ComponentTopics(frozenset({"map", "odom", "joy", "lost"}), frozenset({"out"})),
        "base": ComponentTopics(frozenset({"out"}), frozenset({"odom"})),
        "logger": ComponentTopics(frozenset({"goal"}), frozenset({"log"})),
    }
)
OUTSIDE = dict.fromkeys(["goal", "odom", "joy", "other"], "riot.toml")


def named(result):
    return [one.source for one in result.ranking if one.found]


def edge(result, source, target):
    (found,) = [one for one in result.edges if (one.source, one.target) == (source, target)]
    return found


def test_a_known_graph_is_followed_back_and_externals_are_ranked():
    result = backtrack(pieces(chain), KNOWN, ["out:v"], externals=OUTSIDE)
    assert set(named(result)) == {"goal:v", "odom:v"}
    assert [one.source for one in result.ranking][-1] == "joy:v"
    assert {topic for topic in ("map", "odom") if any(one.found for one in edge(result, topic, "out").evidence)} == {
        "map",
        "odom",
    }
    (silent,) = edge(result, "joy", "out").evidence
    assert (silent.found, silent.rows, silent.logs) == (False, 1200, 4)
    assert edge(result, "goal", "map").evidence[0].found
    assert edge(result, "lost", "out").evidence == ()
    assert result.missing == ["lost"]
    assert result.unreachable == []  # who knows who writes what is lost
    assert result.loops == [("odom", "out")]
    text = text_of(result.trees[0])
    assert "goal via mapper [external]" in text
    assert "log" not in text.replace("logger", "")


def test_an_external_topic_is_unreachable_where_all_writers_are_known():
    result = backtrack(pieces(chain), KNOWN, ["out:v"], externals=OUTSIDE | {"lost": "riot.toml"})
    assert result.unreachable == ["other"]


def test_without_a_graph_the_way_is_inferred_and_marked():
    result = backtrack(pieces(chain), TopicGraph(), ["out:v"], externals={})
    assert {one.source for one in result.edges if one.target == "out"} == {"map", "odom"}
    assert {one.source for one in result.edges if one.target == "map"} == {"goal"}
    assert all(one.told == (INFERRED,) for one in result.edges)
    assert result.externals == {"goal": "nothing recorded leads to it", "odom": "nothing recorded leads to it"}
    assert set(named(result)) == {"goal:v", "odom:v"}
    assert result.unwritten == ["goal", "map", "odom", "out"]


def test_what_an_open_component_reads_is_inferred_beside_what_is_known():
    graph = TopicGraph(
        {
            "planner": ComponentTopics(frozenset({"map"}), frozenset({"out"}), "recorded graph", open=True),
            "mapper": ComponentTopics(frozenset({"goal"}), frozenset({"map"}), "recorded graph"),
        }
    )
    result = backtrack(pieces(chain), graph, ["out:v"], externals={"goal": "--external"})
    assert edge(result, "map", "out").told == ("recorded graph",)
    assert edge(result, "odom", "out").told == (INFERRED,)
    assert result.unwritten == ["odom"]


def test_a_source_that_reads_nothing_is_taken_as_external():
    graph = TopicGraph({**KNOWN.components, "driver": ComponentTopics(frozenset(), frozenset({"goal", "joy"}))})
    result = backtrack(pieces(chain), graph, ["map:v"], externals={})
    assert result.externals == {"goal": "driver reads nothing"}


def test_a_target_that_never_changes_is_told_as_such():
    result = backtrack(
        pieces(lambda rng, n: {"e": red(rng, n), "out": np.ones(n)}), KNOWN, ["out:v"], externals={"e": "--external"}
    )
    assert result.targets == {"out:v": "it never changes within a log"}
    assert result.tested == 0
    assert named(result) == []


def test_topics_without_numbers_are_on_the_way_but_not_missing():
    result = backtrack(pieces(chain), KNOWN, ["out:v"], externals=OUTSIDE, recorded=["lost"])
    assert result.missing == []
    assert edge(result, "lost", "out").evidence == ()


def test_progress_is_told():
    said = []
    backtrack(pieces(chain, logs=2), KNOWN, ["out:v"], externals=OUTSIDE, progress=lambda *args: said.append(args))
    assert said[0] == (1, None, "what out:v follows")


def test_a_target_that_follows_nothing_is_not_external_itself():
    result = backtrack(
        pieces(lambda rng, n: {"e": red(rng, n), "out": red(rng, n)}), TopicGraph(), ["out:v"], externals={}
    )
    assert result.externals == {}
    assert result.ranking == []
    assert text_of(result.trees[0]) == "out"
    assert [one.rows for one in edge(result, "", "out").evidence] == [1200]


def test_without_a_known_way_an_external_topic_is_tried_unless_all_is_known():
    result = backtrack(pieces(chain), TopicGraph(), ["out:v"], externals={"joy": "--external", "odom": "--external"})
    assert [one.source for one in result.ranking] == ["odom:v", "joy:v"]
    assert result.unreachable == []


def test_fields_of_an_external_target_s_own_topic_do_not_compete():
    result = backtrack(pieces(chain), KNOWN, ["odom:v"], externals=OUTSIDE)
    assert {one.source for one in result.ranking} == {"goal:v", "joy:v"}
