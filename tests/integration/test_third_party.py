"""A third-party ROS 2 client that knows nothing of riot_bus talks through `riot router`."""

from __future__ import annotations

import contextlib
import json
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from tests.integration.advanced_tools import cached
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import RouterProcess, riot
from tests.integration.third_party.sdk import RosNode
from tests.tiers import chosen

pytestmark = pytest.mark.integration

HELLO = "hello"
TWIST = "geometry_msgs/msg/Twist"
WAY_NAMES = [f"{how}-{mode}" for how in ("native", "intercepted") for mode in ("client", "peer")]
MODES = pytest.mark.parametrize("mode", ["client", "peer"])
WAYS = pytest.mark.parametrize("way", chosen(WAY_NAMES, gate=("native-peer", "intercepted-client")))
STRING = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
PLAN = """
[[inject]]
topic = "/cmd_vel"
field = "linear.x"
value = -1.5
where = "linear.x > 3"

[[inject]]
topic = "/chatter"
field = "data"
value = "injected: äöü"
where = "data == 'message 3'"
"""


MAP_PLAN = """
[[inject]]
topic = "/map"
field = "data"
value = "another map"
where = "data == 'map 2'"
"""


def environment(router: RouterProcess, segment: str, mode: str) -> dict[str, str]:
    """What `riot router env` prints for a segment; in peer mode, rmw_zenoh's own with another endpoint."""
    if mode == "peer":
        return {"ZENOH_CONFIG_OVERRIDE": f'mode="peer";connect/endpoints=["{router.endpoints[segment]}"]'}
    segments = [f"--segment={name}={endpoint}" for name, endpoint in router.endpoints.items()]
    code, out, err = riot("router", "env", segment, *segments)
    assert code == 0, err
    return dict(word.split("=", 1) for word in shlex.split(out, comments=True) if "=" in word)


@contextlib.contextmanager
def nodes(python: Path, router: RouterProcess, folder: Path, mode: str) -> Iterator[tuple[RosNode, RosNode]]:
    """A node in each segment, named after it."""
    with contextlib.ExitStack() as stack:
        system, unit = (
            stack.enter_context(
                RosNode(
                    python, endpoint, environment=environment(router, name, mode), folder=folder, name=f"{name}_node"
                )
            )
            for name, endpoint in router.endpoints.items()
        )
        yield system, unit


def connect(talker: RosNode, listener: RosNode, topic: str, hello: Any, **more: Any) -> str:
    """Advertise and subscribe, and return the key once messages arrive."""
    listener.do("subscribe", topic, **more)
    key = talker.do("advertise", topic, **more)

    def crossed() -> bool:
        talker.do("publish", topic, messages=[hello])
        return bool(listener.do("received", topic))

    assert wait_until(crossed, 60, interval=0.02), (talker.errors(), listener.errors())
    return str(key)


def exchanged(talker: RosNode, listener: RosNode, topic: str, hello: Any, messages: list[Any]) -> list[Any]:
    """Publish messages; return what arrived, without greetings."""
    talker.do("publish", topic, messages=messages)

    def found() -> list[Any]:
        return [each for each in listener.do("received", topic) if each != hello]

    wait_until(lambda: len(found()) >= len(messages), 60, interval=0.02)
    return found()


@WAYS
def test_topics_and_services_cross_unchanged(python: Path, tmp_path: Path, way: str) -> None:
    how, mode = way.split("-")
    options = ["--intercept=/chatter", "--intercept=/answer"] if how == "intercepted" else []
    with RouterProcess(*options) as router, nodes(python, router, tmp_path, mode) as (system, unit):
        hello = {"data": HELLO}
        messages = [{"data": f"message {number} äöü {'x' * number}"} for number in range(50)]
        for topic, talker, listener in (("/chatter", system, unit), ("/answer", unit, system)):
            connect(talker, listener, topic, hello)
            assert exchanged(talker, listener, topic, hello, messages) == messages
        assert system.errors() + unit.errors() == ""
        unit.do("serve", "/add")
        assert wait_until(lambda: system.do("call", "/add", a=0, b=2, timeout=0.5) == 2, 60)
        assert [system.do("call", "/add", a=number, b=-(2**62)) for number in range(3)] == [
            number - 2**62 for number in range(3)
        ]
        assert system.do("services")["/add"] == ["example_interfaces/srv/AddTwoInts"]
        topics = system.do("topics")
        assert topics["/chatter"] == topics["/answer"] == ["std_msgs/msg/String"]
        code, out, err = router.end(signal.SIGTERM)
        assert (code, err) == (0, "")
        assert {line.split()[0] for line in out.splitlines()[1:]} == ({"/chatter", "/answer"} if options else set())


@MODES
def test_injected_values_arrive_exactly_and_the_rest_unchanged(python: Path, tmp_path: Path, mode: str) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    with RouterProcess(f"--inject={plan}") as router, nodes(python, router, tmp_path, mode) as (system, unit):

        def twist(x: float) -> dict[str, dict[str, float]]:
            return {"linear": {"x": x, "y": 1e300, "z": -0.0}, "angular": {"x": 0.1, "y": float(2**53), "z": 5e-324}}

        connect(system, unit, "/cmd_vel", twist(-1.0), type=TWIST)
        found = exchanged(system, unit, "/cmd_vel", twist(-1.0), [twist(float(number)) for number in range(6)])
        assert repr(found) == repr([twist(x) for x in (0.0, 1.0, 2.0, 3.0, -1.5, -1.5)])

        connect(system, unit, "/chatter", {"data": HELLO})
        sent = [{"data": f"message {number}"} for number in range(5)]
        found = exchanged(system, unit, "/chatter", {"data": HELLO}, sent)
        assert found == [*sent[:3], {"data": "injected: äöü"}, sent[4]]
        assert system.errors() + unit.errors() == ""


@WAYS
def test_late_subscriber_gets_what_was_latched(python: Path, tmp_path: Path, way: str) -> None:
    how, mode = way.split("-")
    intercepted = how == "intercepted"
    plan = tmp_path / "plan.toml"
    plan.write_text(MAP_PLAN)
    with (
        RouterProcess(*([f"--inject={plan}"] if intercepted else [])) as router,
        nodes(python, router, tmp_path, mode) as (_, unit),
        Puppet(router.endpoints["system"], mode=mode) as latched,
    ):
        sent = [{"data": f"map {number}"} for number in range(3)]
        payloads = [f"\0\1\0\0\6\0\0\0{each['data']}\0" for each in sent]
        key = f"0/map/{STRING}"
        latched.do("publish_advanced", key=key, payloads=payloads)
        with open_client(router.endpoints["unit"]) as client:  # the SDK asks for the history once
            assert wait_until(lambda: len(cached(client.session, key)) == len(sent), 60, interval=0.02)
        latched.do("token", key=f"@ros2_lv/0/{latched.zid}/0/1/MP/%/%/latched/%map/{STRING}/:1:,10:,:,:,,")
        assert wait_until(lambda: "/map" in unit.do("topics"), 60)
        unit.do("subscribe", "/map", latched=True)
        expected = {"data": "another map"} if intercepted else sent[-1]
        assert wait_until(lambda: unit.do("received", "/map")[-1:] == [expected], 60, interval=0.02)
        assert not intercepted or sent[-1] not in unit.do("received", "/map")
        assert unit.errors() == ""


def test_graph_names_the_nodes_and_their_topics(python: Path, tmp_path: Path) -> None:
    with RouterProcess("--intercept=/chatter") as router, nodes(python, router, tmp_path, "client") as (system, unit):
        key = connect(system, unit, "/chatter", {"data": HELLO})
        unit.do("serve", "/add")
        expected = {
            ("/chatter", "publishes", "system", system.zid, "/system_node"),
            ("/chatter", "subscribes", "unit", unit.zid, "/unit_node"),
            ("/add", "serves", "unit", unit.zid, "/unit_node"),
        }

        def shown() -> bool:
            code, out, err = riot("graph", "-e", router.endpoints["system"], "--format=json")
            assert code == 0, err
            graph.update(json.loads(out))
            names = {each["key"]: each["name"] for each in graph["topics"]}
            edges = {(names[e["topic"]], e["role"], e["segment"], e["zid"], e["node"]) for e in graph["edges"]}
            return expected <= edges

        graph: dict[str, Any] = {}
        assert wait_until(shown, 60, interval=0.1), graph
        (topic,) = [each for each in graph["topics"] if each["key"] == key]
        assert (topic["name"], topic["type_name"], topic["intercepted"]) == ("/chatter", "std_msgs/msg/String", True)


SERVICE_PLAN = """
[[inject]]
topic = "/add/@request"
field = "a"
value = 1000
where = "b == 3"

[[inject]]
topic = "/add/@reply"
field = "sum"
value = -1
where = "sum == 5"
"""


@MODES
@pytest.mark.parametrize("by_plan", [True, False], ids=["by plan", "by option"])
def test_services_are_intercepted_by_name_and_recorded(
    python: Path, tmp_path: Path, *, mode: str, by_plan: bool
) -> None:
    log, plan = tmp_path / "calls.mcap", tmp_path / "plan.toml"
    plan.write_text(SERVICE_PLAN)
    options = [f"--inject={plan}"] if by_plan else ["--intercept-services=/add"]
    with (
        RouterProcess(*options, f"--record={log}") as router,
        nodes(python, router, tmp_path, mode) as (system, unit),
    ):
        assert "/add/@request" in router.ready
        unit.do("serve", "/add")
        assert wait_until(lambda: "/add" in system.do("services"), 60)
        found = [system.do("call", "/add", a=1, b=b) for b in (2, 3, 4, 5)]
        assert found == ([3, 1003, -1, 6] if by_plan else [3, 4, 5, 6])
        assert system.do("services")["/add"] == ["example_interfaces/srv/AddTwoInts"]
        assert system.errors() + unit.errors() == ""
        code, out, err = router.end(signal.SIGTERM)
        assert (code, err) == (0, "")
    counts = {line.split()[0]: line.split()[1:] for line in out.splitlines()[1:]}
    assert counts["/add/@request"][3] == counts["/add/@reply"][3] == counts["/add/@request"][0]
    with LogReader(log) as reader:
        types = {topic: schema.name for topic, (schema, _) in reader.schemas.items()}
        calls = list(reader.messages(topics=["/add/@request", "/add/@reply"]))[-8:]
    assert types["/add/@request"] == "example_interfaces/srv/AddTwoInts_Request"
    assert types["/add/@reply"] == "example_interfaces/srv/AddTwoInts_Response"
    for request, reply in zip(calls[::2], calls[1::2], strict=True):
        assert request.sequence == reply.sequence
        assert request.attachment is not None
        assert reply.attachment is not None
        assert request.attachment[:8] == reply.attachment[:8]  # the client's own number
