"""A unit that calls a service gets recorded answers when it is tested alone: real processes on a real bus."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.pool.local import Pool
from riot_bus.processes.activity import Idle
from riot_bus.trial.baseline import Baseline
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.types.serve import Request
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.keys import DataKey, build_data_key
from tests.ros2_env import ros2_interpreter

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, sys, threading
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)


def ask(text):
    return [reply.ok.payload.to_string() if reply.ok else "error " + reply.err.payload.to_string()
            for reply in session.get("map/size", payload=text, timeout=20)]


(size,) = ask("at start")  # it does not begin without


def scale(sample):
    answers = ask(sample.payload.to_string())
    session.put("out", json.dumps({"size": int(size), "answers": answers}))


subscriber = session.declare_subscriber("in", scale)
threading.Event().wait()
"""
SYSTEM = """
[system]
nominal = "nominal.mcap"

[components.scaler]
command = ["{python}", "node.py", "{endpoint}"]
inputs = ["in"]
outputs = ["out"]
calls = ["map/size"]
ready = { timeout = 60 }

[unit.scaler]

[[monitors]]
kind = "never"
when = "out where answers[0] == 'error no map'"
"""
LOG = [
    Request(1, "map/size/@request", b"at start", sequence=1),
    Message(2, "map/size/@reply", b"40", sequence=1),
    Message(3, "in", b"one"),
    Request(4, "map/size/@request", b"one", sequence=2),
    Message(5, "map/size/@reply", b"41", sequence=2),
    Message(6, "in", b"two"),
    Request(7, "map/size/@request", b"two", sequence=3),
    Message(8, "map/size/@error", b"no map", sequence=3),
]


ROS_NODE = """
import rclpy
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

rclpy.init()
node = rclpy.create_node("caller")
client = node.create_client(SetBool, "/limit")
client.wait_for_service()
out = node.create_publisher(String, "/out", 10)


def ask(message):
    answer = client.call_async(SetBool.Request(data=message.data))
    answer.add_done_callback(lambda found: out.publish(String(data=found.result().message)))


node.create_subscription(Bool, "/in", ask, 10)
rclpy.spin(node)
"""
ROS_SYSTEM = """
[system]
adapters = ["ros2"]
nominal = "nominal.mcap"

[components.caller]
command = ["sh", "-c", "exec $RIOT_ROS_PYTHON node.py"]
dds = true
inputs = ["/in"]
outputs = ["/out"]
calls = ["/limit"]
ready = { timeout = 90 }

[unit.caller]
settle = { window = 0.1, linger = 0.5, timeout = 20 }

[[monitors]]
kind = "never"
when = "/out where data == 'off is not allowed'"
"""


def write(folder: Path, system: str = SYSTEM, log: list[Message] = LOG) -> Path:
    (folder / "node.py").write_text(NODE)
    (folder / "riot.toml").write_text(system)
    with LogWriter(folder / "nominal.mcap") as writer:
        for message in log:
            writer.write(message)
    return folder / "riot.toml"


def test_recorded_answers_reach_a_unit_that_is_alone(tmp_path: Path) -> None:
    one, two = (message for message in LOG if message.key == "in")
    with Pool(write(tmp_path), 1, keep=tmp_path / "trials") as pool:
        assert pool.execute(IdleTrial("scaler"), TestCase()).verdict is Verdict.PASS
        passes = pool.execute(UnitTrial("scaler"), TestCase((one,)))
        fails = pool.execute(UnitTrial("scaler"), TestCase((one, two)))
    assert (passes.verdict, passes.statistics["outputs"]) == (Verdict.PASS, 1)
    assert fails.verdict is Verdict.FAIL
    assert fails.statistics["outputs"] == 2


@pytest.mark.parametrize(
    ("system", "log", "words"),
    [
        (SYSTEM.replace("map/size", "map/sise"), LOG, "no call of 'map/sise'"),
        (SYSTEM, LOG[2:3], "no call of 'map/size' with a reply"),
        (SYSTEM.replace('nominal = "nominal.mcap"', ""), LOG, "no log is named"),
    ],
)
def test_a_log_without_such_calls_is_told(tmp_path: Path, system: str, log: list[Message], words: str) -> None:
    with (
        Pool(write(tmp_path, system, log), 1, keep=tmp_path / "trials") as pool,
        pytest.raises(ConfigError, match=words),
    ):
        pool.execute(UnitTrial("scaler"), TestCase())


def test_a_ros_client_that_waits_for_its_service_finds_the_recorded_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    hash_of = Ros2Adapter().store.type_hash
    limit, commands = (
        build_data_key(DataKey(0, topic, kind, hash_of(kind)))
        for topic, kind in (("/limit", "std_srvs/srv/SetBool"), ("/in", "std_msgs/msg/Bool"))
    )
    log: list[Message] = []
    for number, (value, answer) in enumerate(((True, "on"), (False, "off is not allowed")), start=1):
        told = answer.encode() + b"\0"
        reply = _cdr(value=True) + b"\0\0\0" + struct.pack("<I", len(told)) + told
        log += [
            Message(3 * number, commands, _cdr(value=value)),
            Request(3 * number + 1, f"{limit}/@request", _cdr(value=value), sequence=number),
            Message(3 * number + 2, f"{limit}/@reply", reply, sequence=number),
        ]
    path = write(tmp_path, ROS_SYSTEM, log)
    (tmp_path / "node.py").write_text(ROS_NODE)
    on, off = log[0], log[3]
    with Pool(path, 1, keep=tmp_path / "trials") as pool:
        seen = pool.execute(IdleTrial("caller"), TestCase()).statistics
        trial = UnitTrial("caller", Baseline(idle=Idle(float(seen["switches"]), float(seen["ran"]))))
        passes = pool.execute(trial, TestCase((on,)))
        fails = pool.execute(trial, TestCase((on, off)))
    assert (passes.violations, passes.statistics["outputs"], passes.detail) == ((), 1, "")
    assert (fails.verdict, fails.statistics["outputs"]) == (Verdict.FAIL, 2)


def _cdr(*, value: bool) -> bytes:
    return b"\0\1\0\0" + bytes([value])
