"""What is recorded behind a bridge is a bag to everybody, and plays into a real ROS 2 domain again."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from riot_bus.play.options import PlayOptions
from riot_bus.play.service import PlayService
from riot_bus.processes.ros_domains import free_domains
from riot_bus.record.options import CaptureOptions
from riot_bus.record.service import CaptureService
from riot_bus.zenoh.session import wait_until
from tests.foxglove_env import foxglove_messages
from tests.integration.bridge_process import BridgeProcess
from tests.integration.rclpy_node import BEST_EFFORT, LATCHED, RELIABLE, RclpyNode
from tests.integration.zenoh_process import ZenohProcess
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = pytest.mark.integration

STORE = get_typestore(Stores.ROS2_KILTED)
MAP, ODOMETRY, JOINTS, STRING = (
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/String",
)
TOPICS: dict[str, tuple[str, dict[str, int]]] = {
    "/map": (MAP, {**LATCHED, "depth": 1}),
    "/odom": (ODOMETRY, BEST_EFFORT),
    "/joint_states": (JOINTS, RELIABLE),
    "/robot/chatter": (STRING, {**RELIABLE, "deadline": 2 * 10**9}),
}
COUNT = 20
WAIT_S = 60.0


def made(kind: str, **values: Any) -> Any:
    return STORE.types[kind](**values)


def message(kind: str, number: int) -> Any:
    stamp = made("builtin_interfaces/msg/Time", sec=number, nanosec=7)
    header = made("std_msgs/msg/Header", stamp=stamp, frame_id="odom")
    point = made("geometry_msgs/msg/Point", x=number / 8, y=-1.5, z=0.0)
    pose = made(
        "geometry_msgs/msg/Pose",
        position=point,
        orientation=made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    still = made("geometry_msgs/msg/Vector3", x=0.0, y=0.25, z=float(number))
    if kind == STRING:
        return made(kind, data=f"message {number} äöü")
    if kind == JOINTS:
        numbers = np.array([number, 0.5])
        return made(kind, header=header, name=["a", "joint b"], position=numbers, velocity=-numbers, effort=numbers[:0])
    if kind == MAP:
        info = made("nav_msgs/msg/MapMetaData", map_load_time=stamp, resolution=0.5, width=2, height=2, origin=pose)
        return made(kind, header=header, info=info, data=np.array([0, 100, -1, number], dtype=np.int8))
    covariance = np.arange(36, dtype=np.float64)
    return made(
        kind,
        header=header,
        child_frame_id="base",
        pose=made("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=made(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=made("geometry_msgs/msg/Twist", linear=still, angular=still),
            covariance=covariance,
        ),
    )


def payload(kind: str, number: int) -> bytes:
    return bytes(STORE.serialize_cdr(message(kind, number), kind))


def is_of(data: bytes, kind: str, number: int) -> bool:
    """DDS fills payloads up to a multiple of four bytes."""
    expected = payload(kind, number)
    return data[4:].rstrip(b"\0") == expected[4:].rstrip(b"\0") and 0 <= len(data) - len(expected) < 4


def numbers_of(topic: str) -> list[int]:
    return [0] if topic == "/map" else list(range(COUNT))


def told(topic: str, values: Any) -> int:
    """The number that a message was made of, from any reader's fields."""

    def get(path: str) -> Any:
        found = values
        for part in path.split("."):
            found = found[part] if isinstance(found, dict) else getattr(found, part)
        return found

    if topic == "/robot/chatter":
        return int(get("data").split()[1])
    if topic == "/joint_states":
        assert list(get("name")) == ["a", "joint b"]
        return int(get("position")[0])
    if topic == "/map":
        assert list(get("data"))[:3] == [0, 100, -1]
        return int(get("data")[3])
    assert list(get("pose.covariance")) == list(range(36))
    return int(get("twist.twist.linear.z"))


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@pytest.fixture
def bag(router: str, tmp_path: Path) -> Path:
    """A bag of the topics of a real node, recorded on the segment."""
    python = ros2_interpreter()
    with free_domains(1) as (domain,):
        environment = ros2_environment(domain, tmp_path)
        options = CaptureOptions(endpoint=router, output=tmp_path / "bag", bag=True, control=False)
        with (
            RclpyNode(python, environment, "robot") as node,
            BridgeProcess(python, environment, router) as bridge,
        ):
            assert bridge.ready.startswith("ready: ")
            for topic, (kind, qos) in TOPICS.items():
                node.do("advertise", topic, type=kind, qos=qos)
            node.do("publish", "/map", payloads=[payload(MAP, 0).hex()])
            with CaptureService(options, warn=lambda line: None) as service:
                for topic in TOPICS:
                    assert wait_until(lambda: node.do("matched", topic) > 0, WAIT_S, interval=0.05)  # noqa: B023
                for topic, (kind, _) in TOPICS.items():
                    if topic != "/map":
                        node.do("publish", topic, payloads=[payload(kind, each).hex() for each in range(COUNT)])
                expected = sum(len(numbers_of(topic)) for topic in TOPICS)
                assert wait_until(lambda: service.status()["messages"] >= expected, WAIT_S)
            assert service.result(), service.result()
            assert service.result().account.recorded == {topic: len(numbers_of(topic)) for topic in TOPICS}
    return tmp_path / "bag"


def test_rosbags_and_both_foxglove_readers_open_it(bag: Path) -> None:
    expected = {topic: numbers_of(topic) for topic in TOPICS}
    found: dict[str, list[int]] = {}
    with AnyReader([bag]) as reader:
        assert {each.topic: each.msgtype for each in reader.connections} == {t: kind for t, (kind, _) in TOPICS.items()}
        for connection, _, raw in reader.messages():
            values = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append(told(connection.topic, values))
            assert is_of(bytes(raw), connection.msgtype, found[connection.topic][-1])
    assert found == expected
    (file,) = bag.glob("*.mcap")
    found = {}
    with file.open("rb") as stream:
        for _, channel, _, values in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found.setdefault(channel.topic, []).append(told(channel.topic, values))
    assert found == expected
    found = {}
    for topic, values in foxglove_messages(file):
        found.setdefault(topic, []).append(told(topic, values))
    assert found == expected


def test_it_plays_into_real_subscribers_with_its_quality_of_service(bag: Path, router: str, tmp_path: Path) -> None:
    python = ros2_interpreter()
    with contextlib.ExitStack() as stack:
        (domain,) = stack.enter_context(free_domains(1))
        environment = ros2_environment(domain, tmp_path)
        bridge = stack.enter_context(BridgeProcess(python, environment, router))
        assert bridge.ready.startswith("ready: ")
        node = stack.enter_context(RclpyNode(python, environment, "sink"))
        for topic, (kind, qos) in TOPICS.items():
            if topic != "/map":
                node.do("subscribe", topic, type=kind, qos=qos)
        options = PlayOptions(logs=[bag], endpoint=router, domain=0, paused=True, wait=0.0, rate=10.0, hold=True)
        service = stack.enter_context(PlayService(options, warn=lambda line: None))

        def offers(topic: str) -> list[list[int]]:
            return [each[2:4] for each in node.do("offers", topic)]

        wanted = {topic: [[qos["reliability"], qos["durability"]]] for topic, (_, qos) in TOPICS.items()}
        assert wait_until(lambda: {topic: offers(topic) for topic in TOPICS} == wanted, WAIT_S, interval=0.05), {
            topic: offers(topic) for topic in TOPICS
        }
        assert wait_until(lambda: set(service._publishing.unmatched()) <= {_key_of(service, "/map")}, WAIT_S)
        service.resume()
        for topic, (kind, _) in TOPICS.items():
            if topic != "/map":
                found = node.do("wait", topic, count=COUNT)
                assert all(is_of(bytes.fromhex(each), kind, n) for n, each in enumerate(found)), topic
        late = stack.enter_context(RclpyNode(python, environment, "late"))
        late.do("subscribe", "/map", type=MAP, qos={**LATCHED, "depth": 1})
        (found,) = late.do("wait", "/map", count=1)
        assert is_of(bytes.fromhex(found), MAP, 0)


def _key_of(service: PlayService, topic: str) -> str:
    return next(key for key in service._publishing._outlets if key.startswith(f"0{topic}/"))
