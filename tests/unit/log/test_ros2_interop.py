"""What LogWriter writes for ROS topics is read by the tools of the ROS world."""

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_ros2.adapter import Ros2Adapter
from tests.robot_bag import robot_bag

STORE = get_typestore(Stores.ROS2_JAZZY)
HASH = STORE.hash_rihs01("nav_msgs/msg/Odometry")
ODOM = f"0/odom/nav_msgs::msg::dds_::Odometry_/{HASH}"
TEXT = f"0/robot/chatter/std_msgs::msg::dds_::String_/{STORE.hash_rihs01('std_msgs/msg/String')}"


def odometry(x):
    types = STORE.types
    time = types["builtin_interfaces/msg/Time"](sec=int(x), nanosec=0)
    vector = types["geometry_msgs/msg/Vector3"]
    import numpy as np

    covariance = np.zeros(36)
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](x, 0.0, 0.0), types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    twist = types["geometry_msgs/msg/Twist"](vector(x, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    message = types["nav_msgs/msg/Odometry"](
        types["std_msgs/msg/Header"](time, "map"),
        "base",
        types["geometry_msgs/msg/PoseWithCovariance"](pose, covariance),
        types["geometry_msgs/msg/TwistWithCovariance"](twist, covariance),
    )
    return bytes(STORE.serialize_cdr(message, "nav_msgs/msg/Odometry"))


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "run_0.mcap"
    with LogWriter(
        path, LogSettings(chunk_bytes=4000), registry=TypeRegistry([Ros2Adapter()]), profile="ros2"
    ) as writer:
        for n in range(20):
            now = 10**18 + n
            writer.write(Message(now, ODOM, odometry(float(n)), attachment=bytes(33), sequence=2 * n), role="original")
            writer.write(
                Message(now, ODOM, odometry(n + 0.5), attachment=bytes(33), sequence=2 * n, publish_time=now - 9)
            )
            text = bytes(STORE.serialize_cdr(STORE.types["std_msgs/msg/String"](f"hello {n}"), "std_msgs/msg/String"))
            writer.write(Message(now, TEXT, text, sequence=2 * n + 1))
    return path


def test_channels_are_as_rosbag2_writes_them(path):
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert set(channels) == {"/odom", "/robot/chatter", "riot/original/odom"}
    odom = channels["/odom"]
    schema = summary.schemas[odom.schema_id]
    assert (odom.message_encoding, schema.encoding, schema.name) == ("cdr", "ros2msg", "nav_msgs/msg/Odometry")
    assert b"MSG: geometry_msgs/" in schema.data
    assert odom.metadata["topic_type_hash"] == HASH
    assert odom.metadata["offered_qos_profiles"].startswith("- history: 1")
    assert odom.metadata["riot.key"] == ODOM


def test_rosbags_reads_it(path):
    with AnyReader([path], default_typestore=STORE) as reader:
        found = [
            reader.deserialize(raw, connection.msgtype).pose.pose.position.x
            for connection, _, raw in reader.messages()
            if connection.topic == "/odom"
        ]
    assert found == [n + 0.5 for n in range(20)]


def test_foxglove_decoder_reads_it(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    assert len(decoded) == 60
    assert [message.data for topic, message in decoded if topic == "/robot/chatter"] == [
        f"hello {n}" for n in range(20)
    ]
    assert [message.pose.pose.position.x for topic, message in decoded if topic == "riot/original/odom"] == list(
        range(20)
    )


def test_our_reader_gives_keys_and_names_back(path):
    with LogReader(path) as reader:
        assert {message.key for message in reader.messages()} == {ODOM, TEXT}
        assert len(list(reader.messages(topics=["/odom"]))) == 20
        assert set(reader.schemas) == {"/odom", "/robot/chatter"}


def test_fields_of_a_foreign_bag_can_be_read_through_its_schemas(tmp_path):
    registry = TypeRegistry([Ros2Adapter()])
    with LogReader(robot_bag(tmp_path / "bag.mcap")) as reader:
        for topic, (schema, encoding) in reader.schemas.items():
            registry.add_schema(topic, schema, encoding)
        first = next(iter(reader.messages(topics=["/odom"])))
    kind = registry.type_of(first.key, payload=first.payload)
    assert kind is not None
    assert kind.read(first.payload, "header.frame_id") == "odom"
