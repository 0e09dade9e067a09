from __future__ import annotations

from typing import Any, get_args

import pytest

from riot_bus.graph.build import build
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, GraphChange, Topic, Unknown
from riot_bus.graph.observations import Observations
from riot_bus.graph.observe import Observer
from riot_bus.graph.processes import SocketOwner, endpoint_of
from riot_bus.graph.sources import AdminView
from riot_bus.graph.tokens import ADVANCED, expressions, parse_token
from riot_bus.types.capabilities import Announcement, Role
from riot_bus.types.port import BridgedLink
from riot_bus.types.registry import TypeRegistry, load_adapters

A, B, C = "aa", "bb", "cc"
TWO = ("in", "out")


def edge(graph: Graph, role: str, topic: str = "k") -> list[Edge]:
    return [each for each in graph.edges if each.role == role and each.topic == topic]


def texts(graph: Graph) -> str:
    return "\n".join(each.text for each in graph.unknown)


def test_tokens_are_those_of_adapters_and_of_advanced_publishers() -> None:
    registry = TypeRegistry(load_adapters(["ros2"]))
    assert expressions(registry) == ["**/@ros2_lv/**", "@/*/@ros2_lv/**", ADVANCED]
    assert expressions(TypeRegistry()) == [ADVANCED]
    entity = "@ros2_lv/7/3f2a/0/11/MS/%/%robot1/nav/%robot1%odom/nav_msgs::msg::dds_::Odometry_/RIHS01_ab/::,10:,:,:,,"
    found = parse_token(entity, registry)
    assert found is not None
    assert (found.role, found.node, found.topic) == ("subscribes", "/robot1/nav", "/robot1/odom")
    assert parse_token(entity, TypeRegistry()) is None
    bridge = parse_token("@/3f/@ros2_lv/MP/robot§odom/nav_msgs§msg§Odometry/:::,", registry)
    assert bridge is not None
    assert (bridge.key, bridge.type_name) == ("robot/odom", "nav_msgs/msg/Odometry")
    advanced = parse_token("a/**/@adv/sub/3f/12/_", registry)
    assert advanced is not None
    assert (advanced.key, advanced.role, advanced.zid) == ("a/**", "subscribes", "3f")
    for text in ("", "a/b", "@ros2_lv", "x/@adv/y/3f/1/_"):
        assert parse_token(text, registry) is None


def test_announced_edges_and_components() -> None:
    token = Announcement(A, "publishes", "k", "/talker", "/k", "pkg/msg/T", "ros2 token")
    seen = Observations(
        segments=TWO,
        sessions={("out", A): "peer", ("in", B): "client"},
        addresses={("out", A): ["tcp/127.0.0.1:5"]},
        owners={"tcp/127.0.0.1:5": SocketOwner(17, "talker")},
        names={B: "unit"},
        tokens={token, Announcement(C, "subscribes", "k", "", "", "", "advanced token")},
        flows={("k", "out"): 12},
        rates={("k", "out"): 3.0},
        intercepted=lambda key: key == "k",
    )
    graph = build(seen)
    assert graph.component(A) == ConnectedComponent(
        "out", A, "peer", "", ("/talker",), ("tcp/127.0.0.1:5",), 17, "talker"
    )
    assert [each.label for each in graph.components] == ["cc", "unit", "/talker"]
    (publisher,) = edge(graph, "publishes")
    assert (publisher.zid, publisher.node, publisher.messages, publisher.rate) == (A, "/talker", 12, 3.0)
    assert publisher.evidence == ("ros2 token", "traffic")
    assert graph.topics == (Topic("k", "/k", "pkg/msg/T", intercepted=True),)
    assert Unknown(C, "", "announces itself, but is connected to no segment: what is between?") in graph.unknown
    assert Unknown(B, "in", "announces nothing: what it publishes and subscribes to shows only by traffic and matching")


def test_a_service_is_intercepted_if_its_calls_are() -> None:
    def marked(role: Role, *, topics: bool, calls: bool) -> bool:
        token = Announcement(A, role, "k", "/node", "/k", "pkg/srv/T", "ros2 token")
        seen = Observations(
            TWO, {("out", A): "peer"}, tokens={token}, intercepted=lambda _: topics, calls_intercepted=lambda _: calls
        )
        (topic,) = build(seen).topics
        return topic.intercepted

    for role in get_args(Role):
        call = role in ("serves", "calls")
        assert marked(role, topics=False, calls=True) == call
        assert marked(role, topics=True, calls=False) == (not call)


@pytest.mark.parametrize(
    ("members", "senders", "expected", "unknown"),
    [
        ([A], [], (A, ("only component", "traffic")), ""),
        ([A, B], [], ("", ("traffic",)), "unknown source in segment out: none of 2 components declares it"),
        ([A, B], [B, "the router"], (B, ("timestamp", "traffic")), ""),
        ([], [], ("", ("traffic",)), "unknown source in segment out: it has no components"),
    ],
)
def test_sources_of_traffic(members: list[str], senders: list[str], expected: tuple[str, object], unknown: str) -> None:
    sessions = {("out", zid): "client" for zid in members}
    seen = Observations(TWO, sessions, flows={("k", "out"): 1}, senders={("k", "out"): senders})
    graph = build(seen)
    (found,) = graph.edges
    assert (found.zid, found.evidence) == expected
    assert unknown in texts(graph)
    assert unknown or "unknown source" not in texts(graph)


def test_two_declared_publishers_leave_the_source_open() -> None:
    tokens = [Announcement(zid, "publishes", "k", "", "", "", "advanced token") for zid in (A, B)]
    sessions = {("out", zid): "client" for zid in (A, B)}
    graph = build(Observations(TWO, sessions, tokens=tokens, flows={("k", "out"): 5}))
    assert [(each.zid, each.messages) for each in edge(graph, "publishes")] == [("", 5), (A, 0), (B, 0)]
    assert "2 components declare it" in texts(graph)


def test_receivers_are_known_as_far_as_matching_tells() -> None:
    sessions = {("in", A): "client", ("out", B): "client", ("out", C): "client"}
    matching = {("in", "cut"), ("out", "cut"), ("in", "free"), ("out", "free")}
    graph = build(Observations(TWO, sessions, matching=matching, intercepted=lambda key: key == "cut", skipped=3))
    assert [(each.segment, each.zid) for each in edge(graph, "subscribes", "cut")] == [("in", A), ("out", "")]
    assert [(each.segment, each.zid) for each in edge(graph, "subscribes", "free")] == [("", "")]
    assert "unknown receiver in segment out: none of 2" in texts(graph)
    assert "which segment shows only for intercepted keys" in texts(graph)
    assert "3 more keys" in texts(graph)
    single = build(Observations(("in",), {("in", A): "client"}, matching={("in", "free")}))
    assert [(each.segment, each.zid) for each in edge(single, "subscribes", "free")] == [("in", A)]


def test_key_expressions_count_for_the_topics_they_include() -> None:
    token = Announcement(A, "subscribes", "a/**", "", "", "", "advanced token")
    seen = Observations(TWO, {("in", A): "peer"}, tokens={token}, flows={("a/b", "out"): 1, ("c", "out"): 1})
    graph = build(seen)
    assert [(each.topic, each.zid) for each in graph.edges if each.role == "subscribes"] == [("a/**", A), ("a/b", A)]


def test_changes_are_named_sorted_and_blind_to_counts() -> None:
    one = Edge("k", "publishes", "out", A, messages=1)
    before = Graph.of([ConnectedComponent("out", A), ConnectedComponent("in", B)], [Topic("k", "k")], [one], [])
    counted = Graph.of(before.components, before.topics, [Edge("k", "publishes", "out", A, messages=2, rate=9)], [])
    assert counted.changes_since(before) == ()
    assert counted == before
    after = Graph.of([ConnectedComponent("out", A, name="x")], [Topic("k", "k")], [one], [Unknown("k", "", "why")])
    assert after.changes_since(before) == (
        GraphChange("component", "changed", "aa in out"),
        GraphChange("component", "vanished", "bb in in"),
        GraphChange("unknown", "appeared", "k: why"),
    )
    assert before.changes_since(Graph())[-1] == GraphChange("topic", "appeared", "k")


def test_admin_answers_are_read_with_suspicion() -> None:
    link = b'{"src":"tcp/a:1","dst":"tcp/b:2"}'
    peer = b'{"peer":"bb","whatami":"peer","links":[' + link + b"]}"
    good = b'{"zid":"aa","metadata":{"name":"x"},"locators":["tcp/a:1"],"sessions":[' + peer + b"]}"
    links = {("tcp/b:2", "tcp/a:1"): "bb"}
    assert AdminView.parse("@/aa/peer", good) == AdminView("aa", "peer", "x", ("tcp/a:1",), {"bb": "peer"}, links)
    assert AdminView.parse("@/bb/peer", good) is None
    for bad in (b"", b"[]", b"null", b'{"zid":"aa","sessions":[1]}', b"\xff", b'{"zid":"aa","locators":null}'):
        assert AdminView.parse("@/aa/peer", bad) is None
    odd = AdminView.parse("@/aa/peer", b'{"zid":"aa","metadata":{"name":[1]}}')
    assert odd is not None
    assert odd.name == ""


def test_locators_of_tcp_have_host_and_port() -> None:
    assert endpoint_of("tls/127.0.0.1:80?so=1#iface=lo") == ("127.0.0.1", 80)
    for text in ("udp/127.0.0.1:80", "unixsock-stream/x", "tcp/:x", ""):
        assert endpoint_of(text) is None


class Flowing:
    """A bus without segments, of which flows are told."""

    sessions: dict[str, Any] = {}  # noqa: RUF012
    ids = ids_ever = intercepted = services = bridged = ()

    def __init__(self, flows: dict[tuple[str, str], int]) -> None:
        self._flows = flows

    def flows(self) -> dict[tuple[str, str], int]:
        return self._flows


def test_of_too_many_keys_the_busiest_are_shown_and_they_stay() -> None:
    flows = {(f"k/{number}", "in"): 1 for number in range(5000)}
    flows["busy", "in"] = 2
    observer = Observer(Flowing(flows), lambda: None, senders=dict, registry=TypeRegistry(), processes=False)
    graph = build(observer.observe())
    assert len(graph.topics) == 2000
    assert edge(graph, "publishes", "busy")
    assert "more keys than the busiest 2000" in texts(graph)
    for key in reversed(list(flows)):
        flows[key] = flows.pop(key)
    assert build(observer.observe()).topics == graph.topics
    flows.clear()
    assert "too many" not in texts(build(observer.observe()))


def test_links_of_a_bridge_in_the_router_are_components() -> None:
    fc = BridgedLink("out", "fc", ("udp/1",), {"m/fc/1/1/A": "1/1", "m/fc/1/2/A": "1/2"}, "m/*/*/*/*")
    gcs = BridgedLink("in", "gcs", (), {}, "m/*/*/*/*")
    log = BridgedLink("out", "log", ("a.tlog",), {"m/log/2/1/A": "2/1"})
    graph = build(
        Observations(
            TWO,
            bridged=(fc, gcs, log),
            flows={("m/fc/1/1/A", "out"): 7, ("other", "in"): 1},
            rates={("m/fc/1/1/A", "out"): 2.0},
            matching=[("in", "m/fc/1/1/A")],
            intercepted=lambda key: True,
        )
    )
    assert [(each.segment, each.label, each.mode, each.nodes, each.addresses) for each in graph.components] == [
        ("in", "gcs", "link", (), ()),
        ("out", "fc", "link", ("1/1", "1/2"), ("udp/1",)),
        ("out", "log", "link", ("2/1",), ("a.tlog",)),
    ]
    found = {(each.topic, each.role, each.zid, each.node, each.messages, each.rate) for each in graph.edges}
    assert found - {("other", "publishes", "", "", 1, 0.0)} == {
        ("m/fc/1/1/A", "publishes", "out/fc", "1/1", 7, 2.0),
        ("m/fc/1/2/A", "publishes", "out/fc", "1/2", 0, 0.0),
        ("m/log/2/1/A", "publishes", "out/log", "2/1", 0, 0.0),
        ("m/fc/1/1/A", "subscribes", "in/gcs", "", 0, 0.0),
        ("m/fc/1/2/A", "subscribes", "in/gcs", "", 0, 0.0),
        ("m/log/2/1/A", "subscribes", "in/gcs", "", 0, 0.0),
        ("m/log/2/1/A", "subscribes", "out/fc", "", 0, 0.0),
    }
    evidence = {each.evidence for each in graph.edges if each.topic == "m/fc/1/1/A"}
    assert evidence == {("bridge", "traffic"), ("bridge",)}
    assert [each.about for each in graph.unknown] == ["other"]
