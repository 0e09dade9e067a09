"""Components that are ready once they offer a service, which nobody has to call for that: on a real bus."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import pytest

from riot_bus.processes.launcher import Launcher
from riot_bus.router.bus import Bus
from riot_bus.router.services.offer import ServiceOffer
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token
from tests.integration.service_tools import Server
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

WAIT_S = 30.0
HASH = "RIHS01_ab"


@contextmanager
def offer(bus: Bus, service: str, registry: TypeRegistry) -> Iterator[ServiceOffer]:
    watch = ServiceOffer(bus.segment("system").session, service, registry)
    try:
        yield watch
    finally:
        watch.close()
        watch.close()


def test_a_service_of_a_key_is_there_while_a_component_serves_it() -> None:
    with (
        Bus({"system": []}) as bus,
        open_client(bus.endpoint("system")) as client,
        offer(bus, "map/size", TypeRegistry()) as watch,
    ):
        assert not watch.there()
        other = Server(client, "map/other")
        server = Server(client, "map/size", complete=False)
        assert wait_until(watch.there, WAIT_S)
        server.leave()
        assert wait_until(lambda: not watch.there(), WAIT_S)
        assert server.asked == other.asked == []


def test_a_service_of_ros_is_there_once_it_is_announced_and_served() -> None:
    registry = TypeRegistry([Ros2Adapter()])
    with Bus({"system": []}) as bus, open_client(bus.endpoint("system")) as client:
        node = Node(3, client.zid, 0, "/planner")

        def endpoint(name: str, role: Literal["SS", "SC"] = "SS") -> NodeEndpoint:
            return NodeEndpoint(node, 1, role, name, "std_srvs/srv/SetBool", HASH)

        liveliness = client.session.liveliness()
        wanted = endpoint("/limit")
        with offer(bus, "/limit", registry) as watch:
            tokens = [liveliness.declare_token(build_token(endpoint("/limit/more")))]
            tokens += [liveliness.declare_token(build_token(endpoint("/limit", "SC")))]  # a caller
            more = Server(client, endpoint("/limit/more").key)
            server = Server(client, wanted.key)
            with offer(bus, "/limit/more", registry) as other:
                assert wait_until(other.there, WAIT_S)  # so all tokens above are known
            assert not watch.there()
            tokens.append(liveliness.declare_token(build_token(wanted)))
            assert wait_until(watch.there, WAIT_S)
            server.leave()
            assert wait_until(lambda: not watch.there(), WAIT_S)
            assert (len(tokens), more.asked) == (3, [])


def test_a_name_that_no_adapter_knows_is_told() -> None:
    with Bus({"system": []}) as bus, pytest.raises(ConfigError, match=r"'/limit' is not a key expression"):
        ServiceOffer(bus.segment("system").session, "/limit", TypeRegistry())


NODE = """
import json, signal, sys, threading
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
subscriber = session.declare_subscriber("ask", lambda sample: None)
asked = threading.Event()
signal.signal(signal.SIGUSR1, lambda *_: asked.set())
print("started", flush=True)
while not asked.wait(0.02):
    pass
server = session.declare_queryable("map/size", lambda query: query.reply(query.key_expr, b"40"))
threading.Event().wait()
"""
SYSTEM = """
[components.part]
command = ["{python}", "node.py", "{endpoint}"]
inputs = ["ask"]
"""


@contextmanager
def started(folder: Path, text: str) -> Iterator[TrialSetup]:
    path = folder / "riot.toml"
    path.write_text(text)
    (folder / "trial").mkdir()
    with (
        Launcher() as launcher,
        TrialSetup(open_system(path), launcher, folder / "trial", segments=["system"]) as one,
    ):
        one.start("part", seed=0)
        yield one


def test_a_component_is_not_ready_before_it_offers_its_service(tmp_path: Path) -> None:
    (tmp_path / "node.py").write_text(NODE)
    with started(tmp_path, f'{SYSTEM}ready = {{ service = "map/size", timeout = 60 }}\n') as one:
        process = one.processes.started["part"]
        assert wait_until(lambda: process.printed() == "started\n", WAIT_S)
        assert "does not offer the service map/size" in str(
            one.readiness._missing("part", one.context.file.components["part"].ready)
        )
        os.kill(process.pid, signal.SIGUSR1)
        one.readiness.wait_subscribed("part", ["ask"])


def test_a_component_without_its_service_is_told(tmp_path: Path) -> None:
    (tmp_path / "node.py").write_text(NODE)
    with (
        started(tmp_path, f'{SYSTEM}ready = {{ service = "map/size", timeout = 3 }}\n') as one,
        pytest.raises(EnvironmentFaultError, match="'part' does not offer the service map/size within 3 s"),
    ):
        one.readiness.wait_subscribed("part", ["ask"])


ROS_NODE = """
import rclpy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

rclpy.init()
node = rclpy.create_node("part")
node.create_subscription(Bool, "/ask", lambda message: None, 10)


def begin():
    timer.cancel()
    node.create_service(SetBool, "/limit", lambda request, response: response)
    print("serves", flush=True)


timer = node.create_timer(2.0, begin)
rclpy.spin(node)
"""
ROS_SYSTEM = """
[system]
adapters = ["ros2"]

[components.part]
command = ["sh", "-c", "exec $RIOT_ROS_PYTHON node.py"]
dds = true
inputs = ["/ask"]
ready = { service = "/limit", timeout = 90 }
"""


def test_a_node_of_ros_is_not_ready_before_it_offers_its_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "node.py").write_text(ROS_NODE)
    given = ros2_environment(0, tmp_path)
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR", "FASTDDS_BUILTIN_TRANSPORTS", "PYTHONUNBUFFERED"):
        monkeypatch.setenv(name, given[name])
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    with started(tmp_path, ROS_SYSTEM) as one:
        one.readiness.wait_ready(["part"])
        assert "serves" in one.processes.started["part"].printed()
