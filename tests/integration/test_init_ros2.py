"""`riot init --ros2` describes third-party nodes that run on a router."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from riot_bus.processes.ros_domains import free_domains
from riot_bus.trial.context import open_system
from riot_bus.zenoh.session import free_endpoint, wait_until
from tests.integration.bridge_process import BridgeProcess
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import RouterProcess, riot
from tests.integration.third_party.sdk import RosNode
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = pytest.mark.integration

TWIST = "geometry_msgs::msg::dds_::Twist_/RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcdddde6fb8d2a"


@contextlib.contextmanager
def system(python: Path, folder: Path) -> Iterator[str]:
    """A talker, a relay and a listener, and one that a token alone speaks of; the endpoint of their router."""
    with RouterProcess() as router, contextlib.ExitStack() as stack:
        endpoint = router.endpoints["system"]
        variables = {"ZENOH_CONFIG_OVERRIDE": f'mode="client";connect/endpoints=["{endpoint}"]'}
        talker, relay, listener = (
            stack.enter_context(RosNode(python, endpoint, environment=variables, folder=folder, name=name))
            for name in ("talker", "relay", "listener")
        )
        talker.do("advertise", "/chatter")
        relay.do("subscribe", "/chatter")
        relay.do("advertise", "/answer")
        relay.do("serve", "/add")
        listener.do("subscribe", "/answer")
        brake = stack.enter_context(Puppet(endpoint, mode="client"))
        brake.do("token", key=f"@ros2_lv/0/{brake.zid}/0/0/NN/%/%robot1/brake")
        brake.do("token", key=f"@ros2_lv/0/{brake.zid}/0/1/MS/%/%robot1/brake/%cmd_vel/{TWIST}/2::,1:,:,:,,")
        brake.do("token", key=f"@ros2_lv/0/{brake.zid}/0/2/MP/%/%robot1/brake/%state/my_msgs::msg::dds_::Brake_/"
                 "TypeHashNotSupported/:1:,1:,:,:,,")  # fmt: skip
        yield endpoint


def test_a_live_system_becomes_a_file_that_riot_reads(python: Path, tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    with system(python, tmp_path) as endpoint:
        found: dict = {}

        def complete() -> bool:
            code, out, err = riot(
                "init", "--ros2", "-e", endpoint, "--seconds=1", "-o", path, "--force", "--format=json"
            )
            assert code == 0, err
            found.update(json.loads(out))
            return len(found["components"]) == 4 and all(e["inputs"] or e["outputs"] for e in found["components"])

        assert wait_until(complete, 60, interval=0.1), found
        code, out, err = riot("init", "--ros2", "-e", endpoint, "--seconds=1", "-o", path)
        assert (code, "there is a system file already" in err, "--force" in err) == (2, True, True), err
        other = tmp_path / "unit.toml"
        code, out, err = riot("init", "--ros2", "-e", endpoint, "--seconds=1", "-o", other, "--unit=relay")
        assert code == 0, err
        assert "FILL IN" in out
        code, out, err = riot("init", "--ros2", "-e", endpoint, "--seconds=1", "-o", tmp_path / "no", "--unit=rely")
        assert (code, "'relay'" in err) == (2, True), err
        assert not (tmp_path / "no").exists()

    context = open_system(path)
    file = context.file
    assert set(file.components) == {"talker", "relay", "listener", "robot1_brake"}
    assert (file.components["relay"].inputs, file.components["relay"].outputs) == (("/chatter",), ("/answer",))
    assert (file.components["talker"].segment, file.components["listener"].segment) == ("outside", "inside")
    assert file.components["relay"].command[1].endswith("ros_node.py")
    assert file.components["relay"].command[-1] == "relay"
    assert file.components["robot1_brake"].env["RMW_IMPLEMENTATION"] == "rmw_zenoh_cpp"
    assert file.external.topics == ("/chatter", "/cmd_vel")
    assert found["external"] == {"/chatter": "from talker", "/cmd_vel": "no publisher was seen"}
    assert found["unknown_types"] == ["my_msgs/msg/Brake"]
    text = path.read_text()
    assert "# std_msgs/msg/String" in text
    assert "# my_msgs/msg/Brake, transient local, depth 1" in text
    assert "serves /add" in text
    assert set(open_system(other).file.unit) == {"relay"}
    other.write_text(other.read_text().replace('command = ["', 'command = ["no-such-program", "'))
    code, out, err = riot("test", "--system", other, "--out", tmp_path / "out")  # what is not filled in is named
    assert (code, "no-such-program" in err) == (4, True), (out, err)


def test_nobody_and_nothing(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    endpoint = free_endpoint()
    code, _, err = riot("init", "--ros2", "-e", endpoint, "-o", path)
    assert (code, f"nobody answers at {endpoint}" in err) == (4, True), err
    with RouterProcess() as router:
        endpoint = router.endpoints["system"]
        code, _, err = riot("init", "--ros2", "-e", endpoint, "--seconds=0.5", "-o", path)
        assert (code, "no ROS 2 nodes were seen" in err, "rmw_zenoh_cpp" in err) == (4, True, True), err
    assert not path.exists()


TALKER = """
import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("unnamed")
publisher = node.create_publisher(String, "/chatter", 10)
node.create_timer(0.05, lambda: publisher.publish(String(data="hello")))
rclpy.spin(node)
"""
LISTENER = """
import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(String, "/chatter", print, 10)
rclpy.spin(node)
"""
LAUNCH = """
import subprocess, sys

nodes = [["talker.py", "--ros-args", "-r", "__node:=mouth"], ["listener.py"]]
for each in [subprocess.Popen([sys.executable, *node]) for node in nodes]:
    each.wait()
"""


def test_nodes_of_dds_behind_a_bridge_are_started_by_what_has_started_them(tmp_path: Path) -> None:
    ros2_python = ros2_interpreter()
    for name, text in (("talker", TALKER), ("listener", LISTENER), ("launch", LAUNCH)):
        (tmp_path / f"{name}.py").write_text(text)
    path = tmp_path / "riot.toml"
    with RouterProcess() as router, contextlib.ExitStack() as stack:
        endpoint = router.endpoints["system"]
        (domain,) = stack.enter_context(free_domains(1))
        environment = ros2_environment(domain, tmp_path)
        stack.enter_context(BridgeProcess(ros2_python, environment, endpoint))
        command = [str(ros2_python), "launch.py"]
        launch = stack.enter_context(
            subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, start_new_session=True)
        )
        stack.callback(os.killpg, launch.pid, signal.SIGKILL)
        found: dict = {}

        def complete() -> bool:
            options = ("-e", endpoint, "--seconds=1", "-o", path, "--force", "--format=json")
            code, out, _ = riot("init", "--ros2", *options)
            found.update(json.loads(out) if code == 0 else {})
            return len(found.get("components", ())) == 2 and all(
                each["inputs"] or each["outputs"] for each in found["components"]
            )

        assert wait_until(complete, 60, interval=0.1), found
    parts = open_system(path).file.components
    assert set(parts) == {"mouth", "listener"}
    for name, part in parts.items():
        assert (part.command, part.cwd, part.only, part.dds) == (tuple(command), str(tmp_path), name, True)
    assert (parts["mouth"].external, parts["listener"].inputs) == (True, ("/chatter",))
