from __future__ import annotations

from dataclasses import replace

from riot_bus.graph.folding import folded, names
from riot_bus.graph.model import Edge, Graph, Topic, Unknown
from riot_bus.graph.render import dot, mermaid, text

DOCK = "nav_msgs/action/Dock"
SERVICES = {
    "send_goal": f"{DOCK}_SendGoal",
    "cancel_goal": "action_msgs/srv/CancelGoal",
    "get_result": f"{DOCK}_GetResult",
}
TOPICS = {"feedback": f"{DOCK}_FeedbackMessage", "status": "action_msgs/msg/GoalStatusArray"}


def part(name: str, type_name: str) -> Topic:
    action_type = DOCK if type_name.startswith(DOCK) else ""
    return Topic(f"0/dock/_action/{name}/T/H", f"/dock/_action/{name}", type_name, False, "/dock", action_type)


PARTS = {name: part(name, type_name) for name, type_name in (SERVICES | TOPICS).items()}
ODOM = Topic("0/odom/T/H", "/odom", "nav_msgs/msg/Odometry")
EDGES = [
    *(Edge(PARTS[name].key, "serves", "in", "aa", "/docking", ("ros2 token",)) for name in SERVICES),
    *(Edge(PARTS[name].key, "publishes", "in", "aa", "/docking", ("ros2 token", "traffic"), 5) for name in TOPICS),
    *(Edge(PARTS[name].key, "calls", "out", "bb", "/mission", ("ros2 token",)) for name in SERVICES),
    *(Edge(PARTS[name].key, "subscribes", "out", "bb", "/mission", ("ros2 token",)) for name in TOPICS),
    Edge(PARTS["feedback"].key, "subscribes", "out", "cc", "/display", ("ros2 token",)),
    Edge(ODOM.key, "publishes", "in", "aa", "/docking"),
]
GRAPH = Graph.of([], [ODOM, *PARTS.values()], EDGES, [Unknown(PARTS["status"].key, "", "why")])


def test_an_action_is_one_topic() -> None:
    found = folded(GRAPH)
    assert found.topics == (Topic("0/dock", "/dock", DOCK, False, "/dock", DOCK), ODOM)
    assert [(e.topic, e.role, e.node, e.messages) for e in found.edges] == [
        ("0/dock", "calls", "/mission", 0),
        ("0/dock", "serves", "/docking", 10),
        ("0/dock", "subscribes", "/display", 0),
        ("0/odom/T/H", "publishes", "/docking", 0),
    ]
    assert found.edges[1].evidence == ("ros2 token", "traffic")
    assert found.unknown == GRAPH.unknown
    assert folded(found) == found


def test_it_is_intercepted_if_a_part_is() -> None:
    parts = [replace(each, intercepted=each.name.endswith("feedback")) for each in PARTS.values()]
    (topic,) = folded(Graph.of([], parts, [], [])).topics
    assert topic.intercepted
    assert topic.type_name == DOCK


def test_what_nobody_announced_stays_apart() -> None:
    edges = [Edge(PARTS["status"].key, role, "in") for role in ("publishes", "subscribes")]
    found = folded(Graph.of([], PARTS.values(), edges, []))
    assert [each.role for each in found.edges] == ["publishes", "subscribes"]


def test_graphs_without_actions_are_as_they_were() -> None:
    graph = Graph.of([], [ODOM], [Edge(ODOM.key, "publishes")], [])
    assert folded(graph) is graph


def test_names_that_do_not_meet_are_told_apart() -> None:
    other = replace(ODOM, key="5/odom/T/H")
    assert names([ODOM, part("status", "x")])[ODOM.key] == "/odom"
    assert names([ODOM, other]) == {ODOM.key: "/odom (0/odom/T/H)", other.key: "/odom (5/odom/T/H)"}


def test_people_see_names() -> None:
    shown = text(GRAPH)
    assert "_action" not in shown.partition("NOT KNOWN")[0]
    assert "/dock/_action/status  why" in shown
    assert "/docking" in shown
    assert "T/H" not in shown
    for drawn in (mermaid(GRAPH), dot(GRAPH)):
        assert "_action" not in drawn
        assert drawn.count('/dock"') == 1
    assert '{{"/dock"}}' in mermaid(GRAPH)
    assert '(["/odom"])' in mermaid(GRAPH)
    assert 'shape=hexagon, label="/dock"' in dot(GRAPH)
