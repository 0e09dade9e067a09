"""Nodes of real ROS 2 with Fast DDS, each segment with a ROS domain of its own: `riot ros-test --dds`, and `dds`."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.sut.context import open_system
from riot_bus.sut.launcher import Launcher
from riot_bus.sut.stage import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until
from tests.integration.existing_suite import ros_test
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = pytest.mark.integration

LISTENER = """
import math, rclpy
from geometry_msgs.msg import Twist

rclpy.init()
node, found = rclpy.create_node("listener"), []
node.create_subscription(Twist, "/cmd_vel", lambda message: found.append(message.linear.x), 10)
while len(found) < 3:
    rclpy.spin_once(node)
print(found, flush=True)
raise SystemExit(0 if all(map(math.isfinite, found)) else 3)
"""
TESTS = """
import rclpy, subprocess, sys
from geometry_msgs.msg import Twist, Vector3

rclpy.init()
node = rclpy.create_node("tests")
publisher = node.create_publisher(Twist, "/cmd_vel", 10)
with subprocess.Popen([sys.executable, "listener.py"]) as listener:
    while listener.poll() is None:
        publisher.publish(Twist(linear=Vector3(x=0.5)))
        rclpy.spin_once(node, timeout_sec=0.05)
raise SystemExit(listener.returncode)
"""


@pytest.fixture
def variables(tmp_path: Path) -> dict[str, str]:
    (tmp_path / "listener.py").write_text(LISTENER)
    (tmp_path / "tests.py").write_text(TESTS)
    log = tmp_path / "log"
    log.mkdir()
    chosen = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR", "FASTDDS_BUILTIN_TRANSPORTS", "PYTHONUNBUFFERED")
    given = ros2_environment(0, log)
    return {**{name: given[name] for name in chosen}, "RIOT_ROS_PYTHON": str(ros2_interpreter())}


def test_dds_nodes_pass_through_the_router(tmp_path: Path, variables: dict[str, str]) -> None:
    command = [variables["RIOT_ROS_PYTHON"], "tests.py"]
    options = ("--dds", "--unit-nodes=listener", "--interceptor=set field=linear.x value=nan select=/cmd_vel")
    code, out, said = ros_test(tmp_path, *options, "--record=run.mcap", command=command, **variables)
    assert (code, out, said[1:]) == (3, "[nan, nan, nan]\n", ["in segment unit: listener"])
    with LogReader(tmp_path / "run.mcap") as log:
        found = [message for message in log.messages() if "cmd_vel" in message.key]
    assert said[0].endswith(f"; recording {tmp_path / 'run.mcap'} ({len(found)} messages)")
    assert len(found) >= 3


def test_all_in_one_domain_is_said(tmp_path: Path, variables: dict[str, str]) -> None:
    command = [variables["RIOT_ROS_PYTHON"], "tests.py"]
    options = ("--dds", "--interceptor=set field=linear.x value=nan select=/cmd_vel")
    code, out, said = ros_test(tmp_path, *options, command=command, **variables)
    assert (code, out) == (0, "[0.5, 0.5, 0.5]\n")
    assert said[1].startswith("NOTHING WAS INTERCEPTED: ")


def test_without_rclpy_it_says_what_is_missing(tmp_path: Path) -> None:
    code, _, said = ros_test(tmp_path, "--dds", command=["true"], RIOT_ROS_PYTHON="no-such-python")
    assert code == 4
    assert said[0].startswith("--dds: no bridge to DDS: ")


CHARGER = Path(__file__).resolve().parents[1] / "systems" / "charger" / "riot.toml"


def test_a_component_gets_a_domain_and_a_bridge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    context = open_system(CHARGER)
    with Launcher() as launcher, TrialSetup(context, launcher, tmp_path, segments=["robot"]) as stage:
        process = stage.start("lamp", seed=0)
        stage.wait_ready(["lamp"])
        (expression,) = context.topics("/battery_state")
        assert not stage.bus.wait_subscribed("robot", [expression], timeout=30)
        node, bridge = stage.threads(["lamp"]).pids[:2]
        assert node == process.pid
        assert stage.view(["lamp"], settled=True, waited=1.0).components[0].status is None
        stage.sample_resources(["lamp"])
        (sample,) = stage.samples("lamp")
        assert (
            sample.threads <= len(os.listdir(f"/proc/{node}/task")) + 2
        )  # those of the bridge are not the component's
        os.kill(bridge, signal.SIGKILL)
        assert wait_until(lambda: _has_no_bridge(stage), 30)


def _has_no_bridge(stage: TrialSetup) -> bool:
    """Return whether the end of the bridge is told, which is no failure of the component."""
    try:
        stage.view(["lamp"], settled=True, waited=1.0)
    except EnvironmentFaultError as error:
        return "the bridge to DDS of component 'lamp' ended with status -9" in str(error)
    return False
