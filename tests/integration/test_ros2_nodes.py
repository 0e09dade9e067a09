"""Nodes of a third-party ROS 2 client on two segments: the same with and without riot, seen by name, and injected."""

from __future__ import annotations

import contextlib
import json
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from riot_bus.zenoh.session import wait_until
from riot_bus_ros2.attachment import Attachment, parse_attachment
from riot_bus_ros2.keys import DataKey, action_parts, build_data_key
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import RouterProcess, riot
from tests.integration.third_party.sdk import RosNode
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

STRING, JOINTS = "std_msgs/msg/String", "sensor_msgs/msg/JointState"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
PARTS = {"header": "std_msgs/msg/Header", "header.stamp": "builtin_interfaces/msg/Time"}
HELLO = {"data": "hello"}
MAP = DataKey(0, "/map", STRING, STRING_HASH)
EVERY_FIFTH = """
import math

class EveryFifth:
    def __init__(self):
        self.seen = 0

    def message(self, event):
        self.seen += 1
        if self.seen % 5 == 0:
            event.set("position[0]", math.nan)
"""


def node(python: Path, endpoint: str, folder: Path, name: str) -> RosNode:
    override = f'mode="client";connect/endpoints=["{endpoint}"]'
    return RosNode(python, endpoint, environment={"ZENOH_CONFIG_OVERRIDE": override}, folder=folder, name=name)


@contextlib.contextmanager
def without_riot() -> Iterator[dict[str, str]]:
    with ZenohProcess("router") as router:
        yield {"system": router.locators[0], "unit": router.locators[0]}


@contextlib.contextmanager
def with_riot(*options: str) -> Iterator[dict[str, str]]:
    with RouterProcess(*options) as router:
        yield router.endpoints


@dataclass
class Seen:
    """What nodes and bystanders have seen of each other; nothing in it depends on who is where."""

    topics: dict[str, list[Any]]
    attachments: dict[str, list[tuple[int, int, bool]]]
    sums: list[int]
    joined: list[str]
    asked: list[str]
    listed: list[dict[str, list[str]]]
    errors: str


def greeted(talker: RosNode, listener: RosNode, topic: str, **more: Any) -> str:
    """Advertise and subscribe; return the key once messages arrive."""
    listener.do("subscribe", topic, **more)
    key = str(talker.do("advertise", topic, **more))

    def crossed() -> bool:
        talker.do("publish", topic, messages=[HELLO])
        return bool(listener.do("received", topic))

    assert wait_until(crossed, 60, interval=0.02), (talker.errors(), listener.errors())
    return key


def raw(puppet: Puppet, least: int) -> list[tuple[bytes, Attachment]]:
    """What a bystander got, in its order: payloads and attachments."""
    found = puppet.do("wait", count=least, timeout=60)
    return [(bytes.fromhex(e["payload"]), parse_attachment(bytes.fromhex(e["attachment"]))) for e in found]


def lived(python: Path, endpoints: dict[str, str], folder: Path) -> Seen:
    """Let a talker, a listener, a service and a transient-local publisher live through the same."""
    topics, attachments = {}, {}
    sent = [{"data": f"message {number} äöü {'x' * number}"} for number in range(30)]
    with contextlib.ExitStack() as stack:
        system = stack.enter_context(node(python, endpoints["system"], folder, "system_node"))
        unit = stack.enter_context(node(python, endpoints["unit"], folder, "unit_node"))
        ways = (("/chatter", system, unit, "unit"), ("/robot/answer", unit, system, "system"))
        for topic, talker, listener, where in ways:
            bystander = stack.enter_context(Puppet(endpoints[where]))
            key = greeted(talker, listener, topic)
            bystander.do("subscribe", key=key)

            def noticed(talker: RosNode = talker, bystander: Puppet = bystander, topic: str = topic) -> bool:
                talker.do("publish", topic, messages=[HELLO])
                return bool(bystander.do("wait", count=1, timeout=0.02))

            assert wait_until(noticed, 60)
            greetings = len(raw(bystander, 1))
            talker.do("publish", topic, messages=sent)

            def told(listener: RosNode = listener, topic: str = topic) -> list[Any]:
                return [each for each in listener.do("received", topic) if each != HELLO]

            wait_until(lambda told=told: len(told()) >= len(sent), 60, interval=0.02)  # type: ignore[misc]
            topics[topic] = told()
            found = [each for _, each in raw(bystander, greetings + len(sent)) if each.version == 2][-len(sent) :]
            attachments[topic] = [(e.sequence - found[0].sequence, e.version, e.gid == found[0].gid) for e in found]
        unit.do("serve", "/add")
        # Zenoh drops, without an answer, what is asked before the way to the server is known, also at plain routers.
        assert wait_until(lambda: system.do("call", "/add", a=0, b=2, timeout=1) == 2, 60)
        early = system.errors()
        assert all(line.endswith("Service call timed out after 1 seconds") for line in early.splitlines()), early
        sums = [system.do("call", "/add", a=number, b=-(2**62)) for number in range(3)]
        latched = stack.enter_context(Puppet(endpoints["system"]))
        latched.do("publish_advanced", key=build_data_key(MAP), payloads=[text(f"map {number}") for number in range(3)])
        publisher = NodeEndpoint(Node(0, latched.zid, 0, "/mapper"), 1, "MP", MAP.topic, STRING, STRING_HASH)
        latched.do("token", key=build_token(publisher))
        late = stack.enter_context(Puppet(endpoints["unit"]))
        late.do("subscribe_advanced", key=build_data_key(MAP))
        joined = [bytes.fromhex(each["payload"])[8:-1].decode() for each in late.do("wait", count=3, timeout=60)]
        assert wait_until(lambda: "/map" in unit.do("topics"), 60)

        def told_once() -> bool:  # the SDK asks when it subscribes, and gives up after two seconds
            unit.do("subscribe", "/map", latched=True)
            return bool(unit.do("received", "/map"))

        wait_until(told_once, 60)
        asked = sorted({each["data"] for each in unit.do("received", "/map")})
        listed = [{name: each.do(what).get(name) for name in names} for each, what, names in listings(system, unit)]
        return Seen(
            topics, attachments, sums, joined, asked, listed, system.errors().removeprefix(early) + unit.errors()
        )


def listings(*of: RosNode) -> Iterator[tuple[RosNode, str, list[str]]]:
    for each in of:
        yield each, "topics", ["/chatter", "/robot/answer", "/map"]
        yield each, "services", ["/add"]


def text(value: str) -> str:
    """A std_msgs/msg/String as the puppet takes payloads."""
    return f"\0\1\0\0{chr(len(value) + 1)}\0\0\0{value}\0"


@pytest.fixture(scope="module")
def plain(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """What nodes see of each other at a plain router."""
    with without_riot() as endpoints:
        return lived(python, endpoints, tmp_path_factory.mktemp("plain"))


def test_a_plain_router_is_what_we_think(plain: Seen) -> None:
    assert [len(messages) for messages in plain.topics.values()] == [30, 30]
    assert plain.attachments["/chatter"] == [(number, 2, True) for number in range(30)]
    assert plain.sums == [number - 2**62 for number in range(3)]
    assert plain.joined == ["map 0", "map 1", "map 2"]
    assert plain.asked == ["map 2"]
    assert plain.listed[0] == {"/chatter": [STRING], "/robot/answer": [STRING], "/map": [STRING]}
    assert plain.listed[1] == {"/add": ["example_interfaces/srv/AddTwoInts"]}
    assert plain.errors == ""


@pytest.mark.parametrize(
    "options",
    [(), ("--intercept=/chatter", "--intercept=/robot/answer", "--intercept=/map"), ("--intercept=/**",)],
    ids=["native", "intercepted", "everything"],
)
def test_nodes_do_not_notice_riot(python: Path, plain: Seen, tmp_path: Path, options: tuple[str, ...]) -> None:
    with with_riot(*options) as endpoints:
        assert lived(python, endpoints, tmp_path) == plain


def definitions(*type_names: str) -> dict[str, str]:
    """Definition files of types and of all that they consist of."""
    found = {}
    for name in type_names:
        for number, part in enumerate(TypeStore().schema(name).data.decode().split("=" * 80 + "\n")):
            title, _, rest = part.partition("\n") if number else (f"MSG: {name}", "\n", part)
            package, _, short = title.removeprefix("MSG: ").rpartition("/")
            found[f"{package.removesuffix('/msg')}/msg/{short}.msg"] = rest
    return found


def joints(number: int) -> dict[str, Any]:
    stamp = {"sec": number, "nanosec": 999_999_999 - number}
    return {
        "header": {"stamp": stamp, "frame_id": "base"},
        "name": ["shoulder", "elbow äöü"],
        "position": [number / 8, -0.0],
        "velocity": [1e300, 5e-324],
        "effort": [],
    }


@pytest.mark.parametrize("domain", [0, 42])
def test_nan_arrives_in_every_fifth_message_and_nothing_else_changes(python: Path, tmp_path: Path, domain: int) -> None:
    file = tmp_path / "every_fifth.py"
    file.write_text(EVERY_FIFTH)
    chosen = f'--interceptor={file} select=/joint_states where="header.stamp.sec > 0"'
    with RouterProcess(chosen) as router, contextlib.ExitStack() as stack:
        system, unit = (
            stack.enter_context(node(python, endpoint, tmp_path, f"{name}_node"))
            for name, endpoint in router.endpoints.items()
        )
        before, after = (stack.enter_context(Puppet(router.endpoints[name])) for name in ("system", "unit"))
        for each in (system, unit):
            each.do("define", definitions=definitions(JOINTS))
        more = {"type": JOINTS, "domain": domain}
        unit.do("subscribe", "/joint_states", **more)
        key = str(system.do("advertise", "/joint_states", **more))
        assert key.startswith(f"{domain}/joint_states/")
        for each in (before, after):
            each.do("subscribe", key=key)

        def publish(*numbers: int) -> None:
            system.do("publish", "/joint_states", messages=[joints(number) for number in numbers], types=PARTS)

        def ready() -> bool:
            publish(0)
            return all(each.do("wait", count=1, timeout=0.02) for each in (before, after)) and bool(
                unit.do("count", "/joint_states")
            )

        assert wait_until(ready, 60), (system.errors(), unit.errors())
        publish(*range(1, 101))

        def got() -> list[Any]:
            return [each for each in unit.do("received", "/joint_states") if each["header"]["stamp"]["sec"] > 0]

        assert wait_until(lambda: len(got()) >= 100, 60, interval=0.05)
        assert [math.isnan(each["position"][0]) for each in got()] == [number % 5 == 0 for number in range(1, 101)]
        expected = [joints(number) for number in range(1, 101)]
        for number, each in enumerate(expected, 1):
            each["position"][0] = math.nan if number % 5 == 0 else each["position"][0]
        assert repr(got()) == repr(expected)
        sent, delivered = (dict(stamped(each)) for each in (before, after))
        assert len(sent) == len(delivered) == 100
        for number, (payload, attachment) in sent.items():
            place = payload.index(struct.pack("<dd", number / 8, -0.0))
            nan = struct.pack("<d", math.nan) if number % 5 == 0 else payload[place : place + 8]
            assert delivered[number] == (payload[:place] + nan + payload[place + 8 :], attachment)
        assert system.errors() + unit.errors() == ""


def stamped(bystander: Puppet) -> Iterator[tuple[int, tuple[bytes, str]]]:
    """The bytes of each message and of its attachment, by what it says in header.stamp.sec."""

    def found() -> list[tuple[int, tuple[bytes, str]]]:
        samples = bystander.do("wait", count=101, timeout=60)
        payloads = [(bytes.fromhex(each["payload"]), each["attachment"]) for each in samples]
        numbers = [int.from_bytes(payload[4:8], "little") for payload, _ in payloads]
        return [(number, each) for number, each in zip(numbers, payloads, strict=True) if number > 0]

    wait_until(lambda: len(found()) >= 100, 60)
    yield from found()


def test_the_graph_speaks_names(python: Path, tmp_path: Path) -> None:
    with RouterProcess("--intercept=/chatter") as router, contextlib.ExitStack() as stack:
        system, unit = (
            stack.enter_context(node(python, endpoint, tmp_path, f"{name}_node"))
            for name, endpoint in router.endpoints.items()
        )
        greeted(system, unit, "/chatter")
        unit.do("serve", "/add")
        system.do("ask", "/add")
        docker = stack.enter_context(Puppet(router.endpoints["unit"]))
        whose = Node(0, docker.zid, 0, "/robot/docker")
        docker.do("token", key=build_token(whose))
        for number, (name, type_name) in enumerate(action_parts("/robot/dock", "nav2_msgs/action/Dock").items(), 1):
            kind = "MP" if name.endswith(("feedback", "status")) else "SS"
            docker.do("token", key=build_token(NodeEndpoint(whose, number, kind, name, type_name)))  # type: ignore[arg-type]
        expected = {
            ("system", "/system_node", "publishes", "/chatter", STRING),
            ("unit", "/unit_node", "subscribes", "/chatter", STRING),
            ("unit", "/unit_node", "serves", "/add", "example_interfaces/srv/AddTwoInts"),
            ("system", "/system_node", "calls", "/add", "example_interfaces/srv/AddTwoInts"),
            ("unit", "/robot/docker", "serves", "/robot/dock", "nav2_msgs/action/Dock"),
        }
        shown = ""

        def complete() -> bool:
            nonlocal shown
            code, shown, err = riot("graph", "-e", router.endpoints["system"])
            assert code == 0, err
            return expected <= {tuple(line.split()[:5]) for line in shown.splitlines()}

        assert wait_until(complete, 120, interval=0.1), shown
        assert "dds_" not in shown
        assert "_action" not in shown
        code, out, err = riot("graph", "-e", router.endpoints["system"], "--format=json")
        assert code == 0, err
        topics = {each["name"]: each for each in json.loads(out)["topics"]}
        assert topics["/robot/dock/_action/feedback"]["action"] == "/robot/dock"
        code, out, err = riot("ctl", "counts", "-e", router.endpoints["system"])
        assert code == 0, err
        assert "/chatter" in out.split()
