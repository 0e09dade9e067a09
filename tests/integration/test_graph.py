from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterator

import pytest

from riot_bus.graph.model import Graph, GraphChange
from riot_bus.graph.render import dot, graph_json, mermaid, text
from riot_bus.graph.watch import GraphWatch
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry, load_adapters
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

WAIT_S = 60.0

TYPE = "std_msgs::msg::dds_::String_/RIHS01_00"


class Watched:
    """A bus, and its flows as the test says; the watch's view alone is under test."""

    def __init__(self, bus: Bus) -> None:
        self.sessions, self.ids_ever, self.intercepted = bus.sessions, bus.ids_ever, ["cut/**", "*/chatter/*/*"]
        self.services, self.bridged = bus.services, bus.bridged
        self.bus = bus
        self.counts: Counter[tuple[str, str]] = Counter()
        self.stamps: dict[tuple[str, str], set[str]] = {}

    @property
    def ids(self) -> set[str]:
        return self.bus.ids

    def flows(self) -> Counter[tuple[str, str]]:
        return self.counts.copy()


@pytest.fixture
def bus() -> Iterator[Bus]:
    with Bus({"outside": [], "inside": []}, intercept=["cut/**", "*/chatter/*/*"]) as opened:
        yield opened


def edges(graph: Graph) -> set[tuple[str, str, str, str, str]]:
    return {(each.topic, each.role, each.segment, each.zid, each.node) for each in graph.edges}


def test_components_are_named_with_process_and_metadata(bus: Bus) -> None:
    with GraphWatch(Watched(bus), period=0.05) as watch:
        with (
            ZenohProcess("client", bus.endpoint("outside"), metadata={"name": "simulator"}) as client,
            ZenohProcess("peer", bus.endpoint("inside"), adminspace__enabled=False) as peer,
        ):

            def complete(graph: Graph) -> bool:
                found = {each.zid: each for each in graph.components}
                return {client.zid, peer.zid} <= found.keys() and found[client.zid].name == "simulator"

            assert watch.wait(complete, WAIT_S)
            one, two = watch.graph.component(client.zid), watch.graph.component(peer.zid)
            assert one is not None
            assert two is not None
            assert (one.segment, one.mode, one.pid) == ("outside", "client", client.process.pid)
            assert (two.segment, two.mode, two.pid) == ("inside", "peer", peer.process.pid)
            assert two.command == "zenoh_process.py"
            assert two.addresses[0].startswith("tcp/127.0.0.1:")
            assert not {each.zid for each in watch.graph.components} & bus.ids
            assert {each.about for each in watch.graph.unknown} >= {client.zid, peer.zid}
        assert watch.wait(lambda graph: not graph.components, WAIT_S)


def test_ros_tokens_tell_nodes_publishers_and_subscribers(bus: Bus) -> None:
    with (
        GraphWatch(Watched(bus), registry=TypeRegistry(load_adapters(["ros2"])), period=0.05) as watch,
        ZenohProcess("client", bus.endpoint("outside")) as talker,
        ZenohProcess("client", bus.endpoint("inside")) as listener,
    ):
        entity = "%/%/{node}/%chatter/" + TYPE + "/::,10:,:,:,,"
        talker.do("token", f"@ros2_lv/0/{talker.zid}/0/0/NN/%/%/talker")
        talker.do("token", f"@ros2_lv/0/{talker.zid}/0/1/MP/" + entity.format(node="talker"))
        listener.do("token", f"@ros2_lv/0/{listener.zid}/0/1/MS/" + entity.format(node="listener"))
        key = f"0/chatter/{TYPE}"
        expected = {
            (key, "publishes", "outside", talker.zid, "/talker"),
            (key, "subscribes", "inside", listener.zid, "/listener"),
        }
        assert watch.wait(lambda graph: edges(graph) == expected, WAIT_S)
        (topic,) = watch.graph.topics
        assert (topic.name, topic.type_name, topic.intercepted) == ("/chatter", "std_msgs/msg/String", True)
        listener.do("undeclare", "")
        assert watch.wait(lambda graph: len(graph.edges) == 1, WAIT_S)


def test_advanced_publishers_are_known_by_their_tokens(bus: Bus) -> None:
    with GraphWatch(Watched(bus), period=0.05) as watch, ZenohProcess("peer", bus.endpoint("inside")) as peer:
        peer.do("advanced", "cut/a")
        assert watch.wait(lambda g: ("cut/a", "publishes", "inside", peer.zid, "") in edges(g), WAIT_S)
        assert watch.graph.edges[0].evidence == ("advanced token",)


def test_traffic_and_matching_show_plain_components_as_far_as_can_be_known(bus: Bus) -> None:
    watched = Watched(bus)
    with (
        GraphWatch(watched, senders=lambda: watched.stamps, period=0.05) as watch,
        ZenohProcess("client", bus.endpoint("outside")) as one,
        ZenohProcess("client", bus.endpoint("outside")) as two,
        ZenohProcess("client", bus.endpoint("inside")) as sink,
    ):
        sink.do("subscribe", "cut/*")
        watched.counts["cut/x", "outside"] = 7
        assert watch.wait(
            lambda graph: (
                edges(graph)
                == {("cut/x", "publishes", "outside", "", ""), ("cut/x", "subscribes", "inside", sink.zid, "")}
            ),
            WAIT_S,
        )
        assert any("unknown source in segment outside" in each.text for each in watch.graph.unknown)
        assert [each.messages for each in watch.graph.edges] == [7, 0]
        assert watch.graph.edges[1].evidence == ("matching", "only component")
        watched.stamps["cut/x", "outside"] = {two.zid, bus.segment("outside").zid}
        assert watch.wait(lambda graph: ("cut/x", "publishes", "outside", two.zid, "") in edges(graph), WAIT_S)
        assert one.zid not in {each.zid for each in watch.graph.edges}
        two.do("subscribe", "cut/x")
        assert watch.wait(lambda graph: ("cut/x", "subscribes", "outside", "", "") in edges(graph), WAIT_S)
        for rendered in (text(watch.graph), mermaid(watch.graph), dot(watch.graph)):
            assert "cut/x" in rendered
        assert json.loads(graph_json(watch.graph))["version"] == 1


def test_only_a_few_of_the_keys_that_come_seldom_are_watched(bus: Bus) -> None:
    watched = Watched(bus)
    watched.counts.update({(f"free/{number}", "outside"): 1 for number in range(300)})
    with GraphWatch(watched, period=0.05) as watch:
        (unknown,) = [each.text for each in watch.refresh().unknown if "too many to watch" in each.text]
        assert unknown == "who would receive 200 more keys: too many to watch"
        watched.counts.update({(f"free/{number}", "outside"): 2 for number in range(300)})
        assert watch.wait(lambda graph: not any("too many" in each.text for each in graph.unknown), WAIT_S)


def test_each_change_is_called_back_and_a_broken_callback_does_no_harm(bus: Bus) -> None:
    seen: list[GraphChange] = []
    arrived = threading.Event()

    def callback(graph: Graph, changes: tuple[GraphChange, ...]) -> None:
        seen.extend(changes)
        arrived.set()
        raise RuntimeError("on purpose")

    with GraphWatch(Watched(bus), callback, period=0.05) as watch:
        with ZenohProcess("client", bus.endpoint("inside")) as client:
            assert arrived.wait(10)
            assert watch.wait(lambda graph: graph.component(client.zid) is not None, WAIT_S)
        assert watch.wait(lambda graph: not graph.components, WAIT_S)
    kinds = [(each.what, each.kind) for each in seen]
    assert ("component", "appeared") in kinds
    assert ("component", "vanished") in kinds


def test_the_router_lives_while_components_declare_and_the_graph_is_watched(bus: Bus) -> None:
    with (
        GraphWatch(Watched(bus), period=0.005) as watch,
        ZenohProcess("client", bus.endpoint("outside")) as one,
        ZenohProcess("client", bus.endpoint("inside")) as two,
    ):
        for number in range(100):
            for client in (one, two):
                client.do("subscribe", f"cut/{number}")
                client.do("publish", f"cut/{number}")
            watch.refresh()
        one.do("undeclare", "")
        assert watch.refresh().components
        assert bus.wait_subscribed("inside", ["cut/99"], timeout=60) == []
