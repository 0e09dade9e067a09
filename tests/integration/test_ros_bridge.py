"""Nodes of real ROS 2 with Fast DDS, each segment with a ROS domain of its own: `riot ros-test --dds`, and `dds`."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.pool.local import Pool
from riot_bus.processes.launcher import Launcher
from riot_bus.system.system_file import RunPace
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.injection import PARAMETERS, Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict
from riot_bus.zenoh.session import wait_until
from riot_bus_ros2.attachment import Attachment, build_attachment
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.store import TypeStore
from tests.integration.existing_suite import ros_test
from tests.ros2_env import ros2_environment, ros2_interpreter
from tests.ros2_messages import encode

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


PLANNER = """
import rclpy
from rcl_interfaces.msg import SetParametersResult
from std_msgs.msg import Float64

rclpy.init()
node = rclpy.create_node("planner")
node.declare_parameter("gain", 5.0)
publisher = node.create_publisher(Float64, "/out", 10)


def gain():
    return node.get_parameter("gain").value


def check(parameters):
    wrong = [each.name for each in parameters if each.value > 10]
    return SetParametersResult(successful=not wrong, reason="at most 10" if wrong else "")


node.add_on_set_parameters_callback(check)
node.create_subscription(Float64, "/in", lambda message: publisher.publish(Float64(data=gain() * message.data)), 10)
rclpy.spin(node)
"""
PLANNERS = """
[system]
name = "gains"
adapters = ["ros2"]
reset = { command = ["true"] }

[external]
topics = ["/in"]
parameters = { gain = { nominal = 2.0, range = [-9, 20], node = "/planner" } }

[components.planner]
command = ["sh", "-c", "exec $RIOT_ROS_PYTHON planner.py"]
dds = true
inputs = ["/in"]
outputs = ["/out"]
ready = { timeout = 90 }
"""


def test_parameters_of_a_node_are_set_before_each_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    (tmp_path / "planner.py").write_text(PLANNER)
    (tmp_path / "riot.toml").write_text(PLANNERS)
    key = build_data_key(DataKey(0, "/in", "std_msgs/msg/Float64", TypeStore().type_hash("std_msgs/msg/Float64")))
    payload = encode("std_msgs/msg/Float64", {"data": 1.0})
    log = tuple(
        Message(10**18 + n * 10**8, key, payload, attachment=build_attachment(Attachment(n, 10**18, bytes(16))))
        for n in range(1, 8)
    )
    gains = [None, 3.0, 11.0, -1, None]
    cases = [TestCase(log, () if each is None else (Injection(PARAMETERS, "gain", each),)) for each in gains]
    with Pool(tmp_path / "riot.toml", 1, keep=tmp_path / "trials") as pool:
        outcomes = [pool.execute(SystemTrial(RunPace(duration=1.0), ("/out:data",)), case) for case in cases]
    assert [one.verdict for one in outcomes] == [Verdict.PASS] * 5, [one.detail for one in outcomes]
    assert [set(one.observed["/out:data"].values) for one in outcomes] == [{2.0}, {3.0}, {2.0}, {-1.0}, {2.0}]
    refused = {"gain": "/planner refused 11.0: at most 10"}
    assert [one.statistics.get("refused", {}) for one in outcomes] == [{}, {}, refused, {}, {}]


CHARGER = Path(__file__).resolve().parents[1] / "systems" / "charger" / "riot.toml"


def test_a_component_gets_a_domain_and_a_bridge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    context = open_system(CHARGER)
    with Launcher() as launcher, TrialSetup(context, launcher, tmp_path, segments=["robot"]) as setup:
        process = setup.start("lamp", seed=0)
        setup.readiness.wait_ready(["lamp"])
        (expression,) = context.topics("/battery_state")
        assert not setup.network.bus.wait_subscribed("robot", [expression], timeout=30)
        node, bridge = setup.observation.threads(["lamp"]).pids[:2]
        assert node == process.pid
        assert setup.view(["lamp"], settled=True, waited=1.0).components[0].status is None
        setup.observation.sample_resources("lamp")
        (sample,) = setup.observation.samples("lamp")
        assert (
            sample.threads <= len(os.listdir(f"/proc/{node}/task")) + 2
        )  # those of the bridge are not the component's
        os.kill(bridge, signal.SIGKILL)
        assert wait_until(lambda: _has_no_bridge(setup), 30)


def _has_no_bridge(setup: TrialSetup) -> bool:
    """Return whether the end of the bridge is told, which is no failure of the component."""
    try:
        setup.view(["lamp"], settled=True, waited=1.0)
    except EnvironmentFaultError as error:
        return "the bridge to DDS of component 'lamp' ended with status -9" in str(error)
    return False
