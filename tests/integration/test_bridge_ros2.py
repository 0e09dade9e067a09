"""Nodes of real ROS 2 in two DDS domains talk through bridge, `riot router`, bridge."""

from __future__ import annotations

import contextlib
import json
import signal
import struct
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from riot_bus.processes.ros_domains import free_domains
from riot_bus.zenoh.session import wait_until
from tests.bags import text
from tests.integration.bridge_process import BridgeProcess
from tests.integration.rclpy_node import BEST_EFFORT, LATCHED, RELIABLE, RclpyNode
from tests.integration.router_process import RouterProcess
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = pytest.mark.integration

STRING = "std_msgs/msg/String"
PLAN = """
[[inject]]
topic = "/chatter"
field = "data"
value = "injected!"
where = "data == 'change me'"
"""
WAIT_S = 60.0


@dataclass
class System:
    """Two domains, and what is between them."""

    python: Path
    router: RouterProcess
    environments: dict[str, dict[str, str]]
    bridges: dict[str, BridgeProcess]
    stack: contextlib.ExitStack

    def node(self, segment: str, name: str, namespace: str = "") -> RclpyNode:
        return self.stack.enter_context(RclpyNode(self.python, self.environments[segment], name, namespace))

    def bridge(self, segment: str, *options: str) -> BridgeProcess:
        endpoint = self.router.endpoints[segment]
        bridge = BridgeProcess(self.python, self.environments[segment], endpoint, *options)
        self.bridges[segment] = self.stack.enter_context(bridge)
        assert "ready" in bridge.ready, bridge.end()
        return bridge


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., System]]:
    """Starts a router with some options, and a bridge at each segment."""
    python = ros2_interpreter()
    with contextlib.ExitStack() as stack:
        domains = stack.enter_context(free_domains(2))

        def begin(*options: str, bridge: tuple[str, ...] = ()) -> System:
            router = stack.enter_context(RouterProcess(*options))
            environments = {
                name: ros2_environment(domain, tmp_path)
                for name, domain in zip(("system", "unit"), domains, strict=True)
            }
            system = System(python, router, environments, {}, stack)
            for segment in environments:
                system.bridge(segment, *bridge)
            return system

        yield begin


def hexed(*values: str) -> list[str]:
    return [text(value).hex() for value in values]


def read(payload: str) -> str:
    data = bytes.fromhex(payload)
    (size,) = struct.unpack_from("<I", data, 4)
    return data[8 : 8 + size - 1].decode()


def joined(talker: RclpyNode, topic: str, count: int = 1) -> None:
    """Wait until a publisher sees subscriptions."""
    assert wait_until(lambda: talker.do("matched", topic) >= count, WAIT_S, interval=0.05)


def send(talker: RclpyNode, listener: RclpyNode, topic: str, values: list[str], *, before: int = 0) -> list[str]:
    """Publish strings a few at a time, and return what arrives."""
    found: list[str] = []
    for begin in range(0, len(values), 100):
        talker.do("publish", topic, payloads=hexed(*values[begin : begin + 100]))
        found = listener.do("wait", topic, count=before + min(begin + 100, len(values)), seconds=20)
    return [read(payload) for payload in found[before:]]


def test_a_thousand_messages_cross_and_injected_ones_are_exact(start: Any, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    system = start(f"--inject={plan}")
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    listener.do("subscribe", "/plain", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/plain", type=STRING, qos=RELIABLE)
    joined(talker, "/plain")
    joined(talker, "/chatter")
    values = ["change me" if number % 7 == 3 else f"message {number} äöü" for number in range(1000)]
    assert send(talker, listener, "/plain", values) == values

    def crossed() -> (
        bool
    ):  # what is intercepted is subscribed to on the segment before anybody listens at the other end
        talker.do("publish", "/chatter", payloads=hexed("hello"))
        return bool(listener.do("wait", "/chatter", count=1, seconds=0.5))

    assert wait_until(crossed, WAIT_S)
    hello = [read(each) for each in listener.do("wait", "/chatter", count=10**6, seconds=1)]
    assert set(hello) == {"hello"}
    found = send(talker, listener, "/chatter", values, before=len(hello))
    assert found == ["injected!" if value == "change me" else value for value in values]
    for bridge in system.bridges.values():
        code, out, err = bridge.end()
        assert (code, err) == (0, ""), err
        assert {line.split()[0] for line in out.splitlines()[1:]} >= {"/chatter", "/plain"}


def test_services_and_actions_are_answered_in_the_other_domain(start: Any) -> None:
    system = start()
    server, caller = system.node("system", "server"), system.node("unit", "caller")
    server.do("serve", "/switch")
    server.do("serve_action", "/count")
    for data in (True, False, True):
        assert caller.do("call", "/switch", data=data) == [not data, f"served by server: {data}"]
    numbers, status, heard = caller.do("act", "/count", order=5)
    assert (numbers, status) == ([0, 1, 1, 2, 3, 5, 8], 4)
    counts = [len(each) for each in heard]  # ROS itself may lose feedback of a goal that has ended
    assert (heard, counts) == ([numbers[:count] for count in counts], sorted(set(counts)))
    _, services = caller.do("names")
    assert "/switch" in services
    assert not [each for each in services if each.startswith("/server/")]  # those of its parameters stay where they are
    code, out, err = system.bridges["unit"].end()
    assert (code, err) == (0, "")
    assert "3 calls" in next(line for line in out.splitlines() if line.startswith("/switch"))


def test_late_joiners_get_what_is_latched_and_qualities_of_service_are_kept(start: Any) -> None:
    system = start()
    source, sink = system.node("system", "source", "/robot"), system.node("unit", "sink")
    for topic, qos in (("/map", LATCHED), ("/scan", BEST_EFFORT), ("/odom", {**RELIABLE, "deadline": 10**9})):
        source.do("advertise", topic, type=STRING, qos=qos)
    source.do("publish", "/map", payloads=hexed(*(f"map {number}" for number in range(8))))
    offers: dict[str, list[Any]] = {}

    def offered() -> bool:
        for topic in ("/map", "/scan", "/odom"):
            offers[topic] = [each[1:] for each in sink.do("offers", topic)]
        return all(offers.values())

    assert wait_until(offered, WAIT_S, interval=0.1)
    forever = offers["/map"][0][-1]
    assert offers == {
        "/map": [[STRING, 1, 1, forever]],
        "/scan": [[STRING, 2, 2, forever]],
        "/odom": [[STRING, 1, 2, 10**9]],
    }
    sink.do("subscribe", "/map", type=STRING, qos={**LATCHED, "depth": 100})
    kept = [f"map {number}" for number in range(3, 8)]
    assert [read(each) for each in sink.do("wait", "/map", count=5)] == kept
    later = system.node("unit", "later")
    later.do("subscribe", "/map", type=STRING, qos={**LATCHED, "depth": 100})
    assert [read(each) for each in later.do("wait", "/map", count=5)] == kept
    source.do("publish", "/map", payloads=hexed("another map"))
    for node in (sink, later):
        assert [read(each) for each in node.do("wait", "/map", count=6)] == [*kept, "another map"]
    source.do("advertise", "/chatter", type=STRING, qos=RELIABLE)  # nobody wants it: it is not even subscribed to
    sink.do("subscribe", "/scan", type=STRING, qos=BEST_EFFORT)
    joined(source, "/scan")
    assert source.do("matched", "/chatter") == 0


def test_who_does_not_match_in_one_domain_does_not_match_across(start: Any) -> None:
    system = start()
    source, sink, other = system.node("system", "source"), system.node("unit", "sink"), system.node("unit", "other")
    second = 10**9
    late = {**RELIABLE, "deadline": 2 * second}
    for topic, offered, refused, taken in (
        ("/scan", BEST_EFFORT, RELIABLE, BEST_EFFORT),
        ("/pose", RELIABLE, LATCHED, RELIABLE),
        ("/odom", late, {**late, "deadline": second}, {**late, "deadline": 3 * second}),
    ):
        source.do("advertise", topic, type=STRING, qos=offered)
        sink.do("subscribe", topic, type=STRING, qos=refused)
        other.do("subscribe", topic, type=STRING, qos=taken)

        def crossed(topic: str = topic) -> bool:
            source.do("publish", topic, payloads=hexed("one"))
            return bool(other.do("wait", topic, count=1, seconds=0.5))

        assert wait_until(crossed, WAIT_S)
        assert sink.do("wait", topic, count=1, seconds=0.2) == []
        other.do("unsubscribe", topic)
        assert wait_until(lambda topic=topic: source.do("matched", topic) == 0, WAIT_S, interval=0.05)


def test_latched_messages_come_once_whoever_joins_and_leaves(start: Any) -> None:
    system = start()
    listener = system.node("unit", "listener")
    listener.do("subscribe", "/tf_static", type=STRING, qos={**LATCHED, "depth": 100})
    expected: list[str] = []
    nodes = []
    for name in ("one", "two", "three"):
        nodes.append(system.node("system", name))
        nodes[-1].do("advertise", "/tf_static", type=STRING, qos=LATCHED)
        nodes[-1].do("publish", "/tf_static", payloads=hexed(name))
        expected.append(name)
        assert [read(each) for each in listener.do("wait", "/tf_static", count=len(expected))] == expected
    nodes[0].end()
    assert wait_until(lambda: len(nodes[1].do("offers", "/tf_static")) == 2, WAIT_S, interval=0.1)
    nodes[1].do("publish", "/tf_static", payloads=hexed("two again"))
    found = listener.do("wait", "/tf_static", count=5, seconds=4)  # and none of the former comes again
    assert [read(each) for each in found] == [*expected, "two again"]


def test_what_has_arrived_crosses_though_the_bridge_is_ended(start: Any) -> None:
    system = start()
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
    joined(talker, "/chatter")
    values = [f"message {number}" for number in range(800)]
    talker.do("publish", "/chatter", payloads=hexed(*values))
    assert talker.do("acknowledged", "/chatter") == "yes"
    code, out, err = system.bridges["system"].end()
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].split() == ["/chatter", "800", "0"]
    assert [read(each) for each in listener.do("wait", "/chatter", count=800)] == values


@pytest.mark.nightly
def test_servers_may_take_their_time(start: Any) -> None:
    seconds = 11.0  # by default, Zenoh waits for answers for 10 s
    system = start("--intercept-services=/watched")
    callers = {}
    for topic in ("/slow", "/watched"):
        system.node("system", f"server_of{topic}".replace("/", "_")).do("serve", topic, seconds=seconds)
        callers[topic] = system.node("unit", f"caller_of{topic}".replace("/", "_"))
    with ThreadPoolExecutor(2) as pool:
        answers = {topic: pool.submit(caller.do, "call", topic, data=True) for topic, caller in callers.items()}
        for topic, answer in answers.items():
            expected = f"served by server_of{topic}: True".replace("/", "_")
            assert answer.result(WAIT_S) == [False, expected]


def test_publishers_on_both_sides_hear_each_other_once(start: Any) -> None:
    system = start()
    one, other = system.node("system", "one"), system.node("unit", "other")
    for node in (one, other):
        node.do("advertise", "/tf", type=STRING, qos=RELIABLE)
        node.do("subscribe", "/tf", type=STRING, qos=RELIABLE)
    for node in (one, other):
        joined(node, "/tf", 2)  # its own subscription, and that of its bridge
    expected = {"one": [], "other": []}  # type: dict[str, list[str]]
    for number in range(100):
        one.do("publish", "/tf", payloads=hexed(f"one {number}", "the same"))
        other.do("publish", "/tf", payloads=hexed(f"other {number}", "the same"))
        expected["one"] += [f"one {number}", "the same"]
        expected["other"] += [f"other {number}", "the same"]
    everything = sorted(expected["one"] + expected["other"])
    for node in (one, other):
        found = [read(each) for each in node.do("wait", "/tf", count=400)]
        assert sorted(found) == everything
        for name in expected:
            assert [each for each in found if each.startswith(f"{name} ")] == [f"{name} {n}" for n in range(100)]
    assert [len(node.do("wait", "/tf", count=401, seconds=2)) for node in (one, other)] == [400, 400]


def test_nodes_may_come_again(start: Any) -> None:
    system = start()
    listener = system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    expected: list[str] = []
    for life in range(3):
        talker = system.node("system", "talker")
        talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
        joined(talker, "/chatter")
        expected += [f"life {life} message {number}" for number in range(50)]
        talker.do("publish", "/chatter", payloads=hexed(*expected[-50:]))
        assert talker.do("acknowledged", "/chatter") == "yes"
        talker.end()
        assert [read(each) for each in listener.do("wait", "/chatter", count=len(expected))] == expected
    listener.end()
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["again"]) == ["again"]
    unit = system.bridges["unit"]
    code, _, err = unit.end(signal.SIGINT)
    assert (code, err) == (0, "")
    assert wait_until(lambda: talker.do("matched", "/chatter") == 0, WAIT_S, interval=0.05)
    system.bridge("unit")
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["and again"], before=1) == ["and again"]


def test_a_second_bridge_of_a_domain_is_refused(start: Any) -> None:
    system = start()
    second = system.stack.enter_context(
        BridgeProcess(system.python, system.environments["unit"], system.router.endpoints["system"])
    )
    code, _, err = second.outcome()
    assert code == 4
    assert "relays ROS domain" in err
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["works"]) == ["works"]


def test_of_two_bridges_that_start_together_one_stays_and_nothing_comes_twice(tmp_path: Path) -> None:
    python = ros2_interpreter()
    with contextlib.ExitStack() as stack:
        (domain,) = stack.enter_context(free_domains(1))
        environment = ros2_environment(domain, tmp_path)
        router = stack.enter_context(RouterProcess())
        talker, listener = (stack.enter_context(RclpyNode(python, environment, name)) for name in ("a", "b"))
        for node in (talker, listener):
            node.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
            node.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
        joined(talker, "/chatter", 2)
        with ThreadPoolExecutor(2) as pool:
            begin = [pool.submit(BridgeProcess, python, environment, router.endpoints[s]) for s in ("system", "unit")]
            sent = 0
            while not all(each.done() for each in begin):
                talker.do("publish", "/chatter", payloads=hexed(str(sent)))
                sent += 1
                listener.do("wait", "/chatter", count=sent)
            bridges = [stack.enter_context(each.result()) for each in begin]
        (loser,) = [each for each in bridges if not each.ready]
        code, _, err = loser.outcome()
        assert (code, "relays ROS domain" in err) == (4, True)
        assert send(talker, listener, "/chatter", ["last"], before=sent) == ["last"]
        found = listener.do("wait", "/chatter", count=sent + 2, seconds=2)
        assert [read(each) for each in found] == [*map(str, range(sent)), "last"]


def test_a_router_may_come_again(start: Any) -> None:
    system = start()
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    for topic, qos in (("/chatter", RELIABLE), ("/map", LATCHED)):
        listener.do("subscribe", topic, type=STRING, qos=qos)
        talker.do("advertise", topic, type=STRING, qos=qos)
    talker.do("publish", "/map", payloads=hexed("map"))
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["before"]) == ["before"]
    system.router.end(signal.SIGKILL)
    assert wait_until(lambda: talker.do("matched", "/chatter") == 0, WAIT_S, interval=0.05)
    system.stack.enter_context(RouterProcess(endpoints=system.router.endpoints))
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["after"], before=1) == ["after"]
    assert [read(each) for each in listener.do("wait", "/map", count=1)] == ["map"]


def test_what_does_not_find_time_to_cross_is_counted(start: Any) -> None:
    system = start(bridge=("--depth=1", "--format=json"))
    talker, listener = system.node("system", "talker"), system.node("unit", "listener")
    listener.do("subscribe", "/chatter", type=STRING, qos=RELIABLE)
    talker.do("advertise", "/chatter", type=STRING, qos=RELIABLE)
    joined(talker, "/chatter")
    assert send(talker, listener, "/chatter", ["first"]) == ["first"]
    bridge = system.bridges["system"]
    (node,) = psutil.Process(bridge.process.pid).children()
    node.suspend()
    talker.do("publish", "/chatter", payloads=hexed(*(f"message {number}" for number in range(50))))
    node.resume()
    assert wait_until(lambda: read(listener.do("wait", "/chatter", count=2)[-1]) == "message 49", WAIT_S, interval=0.05)
    assert bridge.process.stderr is not None
    assert "/chatter: messages come faster" in bridge.process.stderr.readline()
    code, out, _ = bridge.end()
    ended = json.loads(out)
    assert (code, ended["topics"]["/chatter"]["to_segment"] + ended["lost"]["/chatter"]) == (0, 51)
