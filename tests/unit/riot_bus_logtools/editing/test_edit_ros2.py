"""Edited bags are read by the tools of the ROS world, and what was not touched is what it was."""

import math
from pathlib import Path

import pytest

pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_ros2.adapter import Ros2Adapter
from tests.bags import FOREVER
from tests.robot_bag import robot_bag
from tests.unit.riot_bus_logtools.editing.edit_tools import BEGIN, SECOND, chunk_sizes, counts, json_log, raw, run

STORE = get_typestore(Stores.ROS2_JAZZY)
NAMES = (
    "- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: volatile\n  liveliness: automatic\n"
    f"{FOREVER}  avoid_ros_namespace_conventions: false"
)
NUMBERS = (
    "- history: 1\n  depth: 10\n  reliability: 1\n  durability: 2\n  liveliness: 1\n"
    f"{FOREVER}  avoid_ros_namespace_conventions: false"
)
HASHES = {name: STORE.hash_rihs01(name) for name in ("geometry_msgs/msg/Point", "std_msgs/msg/String")}
HASH = HASHES["std_msgs/msg/String"]


def point(x):
    return bytes(STORE.serialize_cdr(STORE.types["geometry_msgs/msg/Point"](x, 2.0, 3.0), "geometry_msgs/msg/Point"))


def text(value):
    return bytes(STORE.serialize_cdr(STORE.types["std_msgs/msg/String"](value), "std_msgs/msg/String"))


def rosbag2(path, count=40, *, qos=NAMES, record=None, begin=BEGIN):
    """A bag as rosbag2 writes it: /point and /text in turn, ten messages a second."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=800, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="libmcap 1.4.0")
        channels = []
        for name, type_name in (("/point", "geometry_msgs/msg/Point"), ("/text", "std_msgs/msg/String")):
            definition, _ = STORE.generate_msgdef(type_name, ros_version=2)
            schema = writer.register_schema(type_name, "ros2msg", definition.encode())
            details = {"offered_qos_profiles": qos, "topic_type_hash": HASHES[type_name]}
            channels.append(writer.register_channel(name, "cdr", schema, details))
        for n in range(count):
            data = text(f"text {n}") if n % 2 else point(float(n))
            writer.add_message(channels[n % 2], begin + n * SECOND // 10, data, begin + n * SECOND // 10 - 100)
        if record is not None:
            writer.add_metadata("rosbag2", {"serialized_metadata": record})
        writer.finish()
    return path


def decoded(*paths):
    """Topic, time and x or text of all messages."""
    with AnyReader(list(paths), default_typestore=STORE) as reader:
        found = []
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.append((connection.topic, time, getattr(message, "x", getattr(message, "data", None))))
        return found


def test_one_field_is_set_and_rosbags_reads_the_result(tmp_path):
    log = rosbag2(tmp_path / "in.mcap")
    out = tmp_path / "out.mcap"
    result = run(log, out, changes=["/point:x = -5 where x >= 20 and y == 2"])
    assert counts(result) == {"/point": (20, 10, 0), "/text": (20, 0, 0)}
    before, after = decoded(log), decoded(out)
    assert after == [
        (topic, time, -5.0 if topic == "/point" and value >= 20 else value) for topic, time, value in before
    ]
    untouched = [each for n, each in enumerate(raw(log)) if n % 2 or n < 20]
    assert [each for n, each in enumerate(raw(out)) if n % 2 or n < 20] == untouched


@pytest.mark.parametrize(("qos", "version"), [(NAMES, 9), (NUMBERS, 8), ("", 8)])
def test_the_folder_of_a_bag(tmp_path, qos, version):
    log = rosbag2(tmp_path / "in.mcap", qos=qos)
    result = run(log, tmp_path / "cut", start="1", end="3", remap=["/text:=/chatter"])
    assert sorted(each.name for each in (tmp_path / "cut").iterdir()) == ["cut_0.mcap", "metadata.yaml"]
    assert [each.path for each in result.files] == [str(tmp_path / "cut" / "cut_0.mcap")]
    found = YAML(typ="safe").load((tmp_path / "cut" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (found["version"], found["message_count"], found["storage_identifier"]) == (version, 20, "mcap")
    assert found["starting_time"]["nanoseconds_since_epoch"] == BEGIN + SECOND
    assert found["duration"]["nanoseconds"] == 19 * SECOND // 10
    topics = {each["topic_metadata"]["name"]: each for each in found["topics_with_message_count"]}
    assert {name: each["message_count"] for name, each in topics.items()} == {"/point": 10, "/chatter": 10}
    point_topic = topics["/point"]["topic_metadata"]
    assert (point_topic["type"], point_topic["type_description_hash"]) == (
        "geometry_msgs/msg/Point",
        HASHES["geometry_msgs/msg/Point"],
    )
    if version == 9:
        assert point_topic["offered_qos_profiles"][0]["reliability"] == "reliable"
    else:
        assert point_topic["offered_qos_profiles"] == qos
    with Reader(tmp_path / "cut") as reader:
        assert reader.message_count == 20
        assert len(list(reader.messages())) == 20
    assert [value for topic, _, value in decoded(tmp_path / "cut") if topic == "/chatter"] == [
        f"text {n}" for n in range(11, 30, 2)
    ]


def test_a_folder_is_an_input_with_all_its_files_in_order(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    for n in (10, 2, 0):
        rosbag2(folder / f"bag_{n}.mcap", 10, begin=BEGIN + n * SECOND)
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 9\n  custom_data:\n    robot: r2\n  ros_distro: jazzy\n"
    )
    run(folder, tmp_path / "out.mcap")
    parts = [each for n in (0, 2, 10) for each in raw(folder / f"bag_{n}.mcap")]
    assert raw(tmp_path / "out.mcap") == parts
    run(folder, tmp_path / "again", split_seconds=1.0)
    found = YAML(typ="safe").load((tmp_path / "again" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (found["custom_data"], found["ros_distro"]) == ({"robot": "r2"}, "jazzy")
    assert found["relative_file_paths"] == ["again_0.mcap", "again_1.mcap", "again_2.mcap"]
    assert [(each["path"], each["message_count"]) for each in found["files"]] == [
        (f"again_{n}.mcap", 10) for n in range(3)
    ]
    with Reader(tmp_path / "again") as reader:
        assert len(list(reader.messages())) == 30


def latched_bag(path, rows):
    """Texts of a latched topic and of another: topic, seconds and text in this order."""
    latched = NUMBERS.replace("durability: 2", "durability: 1").replace("depth: 10", "depth: 2")
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300)
        writer.start(profile="ros2")
        definition, _ = STORE.generate_msgdef("std_msgs/msg/String", ros_version=2)
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", definition.encode())
        channels = {
            name: writer.register_channel(name, "cdr", schema, {"offered_qos_profiles": qos, "topic_type_hash": HASH})
            for name, qos in (("/map", latched), ("/text", NUMBERS))
        }
        for name, seconds, value in rows:
            time = BEGIN + int(seconds * SECOND)
            writer.add_message(channels[name], time, text(value), time - 9)
        writer.finish()
    return path


@pytest.mark.parametrize("begin", [5.0, 9.5, 20.0])
def test_a_slice_may_begin_with_what_is_latched(tmp_path, begin):
    rows = [("/map", n, f"map {n}") for n in (0, 1, 3, 6)] + [("/text", n / 2, f"{n}") for n in range(20)]
    log = latched_bag(tmp_path / "in.mcap", rows)
    result = run(log, tmp_path / "out.mcap", start=str(begin), latched=True)
    held = [name for name, seconds, value in rows if name == "/map" and seconds < begin]
    last = [value for name, seconds, value in rows if name == "/map" and seconds < begin][-2:]
    inside = [(each.topic, each.time, each.data) for each in sorted(raw(log), key=lambda each: each.time)]
    start = BEGIN + int(begin * SECOND)
    expected = [("/map", start, text(value)) for value in last] + [each for each in inside if each[1] >= start]
    found = raw(tmp_path / "out.mcap")
    assert [(each.topic, each.time, each.data) for each in found] == expected
    assert [each.published for each in found if each.time == start and each.topic == "/map"] == [start - 9] * 2
    assert counts(result)["/map"] == (4 - len(held) + 2, 2, len(held) - 2)
    run(log, tmp_path / "without.mcap", start=str(begin))
    assert [(each.topic, each.time, each.data) for each in raw(tmp_path / "without.mcap")] == [
        (each.topic, each.time, each.data) for each in raw(log) if each.time >= start
    ]


def test_folders_without_a_bag_and_compressed_bags(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=r"no \.mcap files"):
        run(tmp_path / "empty", tmp_path / "out.mcap")
    (tmp_path / "empty" / "a.mcap.zstd").write_bytes(b"x")
    with pytest.raises(ConfigError, match="compressed as a whole"):
        run(tmp_path / "empty", tmp_path / "out.mcap")


def test_the_record_of_rosbag2_tells_the_truth_again(tmp_path):
    record = "version: 9\nmessage_count: 40\ntopics_with_message_count:\n  []\ncustom_data:\n  a: b\nros_distro: kilted"
    log = rosbag2(tmp_path / "in.mcap", record=record)
    run(log, tmp_path / "out.mcap", drop=["/text"])
    with (tmp_path / "out.mcap").open("rb") as file:
        (found,) = [each.metadata for each in make_reader(file).iter_metadata() if each.name == "rosbag2"]
    said = YAML(typ="safe").load(found["serialized_metadata"])
    assert (said["version"], said["message_count"], said["ros_distro"]) == (9, 20, "kilted")
    assert said["custom_data"] == {"a": "b"}
    assert [each["topic_metadata"]["name"] for each in said["topics_with_message_count"]] == ["/point"]


def test_originals_do_not_get_into_a_bag(tmp_path):
    path = tmp_path / "in.mcap"
    key = f"0/text/std_msgs::msg::dds_::String_/{HASH}"
    with LogWriter(path, registry=TypeRegistry([Ros2Adapter()]), profile="ros2") as writer:
        writer.write(Message(BEGIN, key, text("before"), attachment=bytes(33)), role="original")
        writer.write(Message(BEGIN, key, text("after"), attachment=bytes(33)))
    run(path, tmp_path / "bag")
    assert decoded(tmp_path / "bag") == [("/text", BEGIN, "after")]
    assert [each.topic for each in raw(tmp_path / "bag" / "bag_0.mcap")] == ["/text"]


def test_topics_that_ros_2_cannot_read_are_told(tmp_path):
    log = json_log(tmp_path / "in.mcap", 10)
    result = run(log, tmp_path / "bag")
    assert "ros2 bag reads no bag with topics that are not of ROS 2: a, b" in result.warnings[0]
    assert run(log, tmp_path / "out.mcap").warnings == []


def test_split_by_topic(tmp_path):
    log = rosbag2(tmp_path / "in.mcap")
    result = run(log, tmp_path / "out.mcap", split_topics=True)
    assert {Path(each.path).name: each.messages for each in result.files} == {"out_point.mcap": 20, "out_text.mcap": 20}
    assert raw(tmp_path / "out_point.mcap") + raw(tmp_path / "out_text.mcap") == sorted(raw(log), key=lambda m: m.topic)
    assert len(decoded(tmp_path / "out_text.mcap")) == 20


def test_split_by_size_and_by_time(tmp_path):
    log = rosbag2(tmp_path / "in.mcap", 400)
    result = run(log, tmp_path / "out.mcap", split_bytes=9000, compression="none", chunk_bytes=1000)
    paths = [Path(each.path) for each in result.files]
    assert [each.name for each in paths] == [f"out_{n}.mcap" for n in range(len(paths))]
    assert len(paths) > 2
    assert [each for path in paths for each in raw(path)] == raw(log)
    assert all(each.size < 16_000 for each in result.files)
    result = run(log, tmp_path / "time.mcap", split_seconds=7.0)
    assert [each.messages for each in result.files] == [70, 70, 70, 70, 70, 50]
    assert [each for file in result.files for each in raw(Path(file.path))] == raw(log)


class TestRobot:
    def test_one_field_changes_and_nothing_else(self, tmp_path):
        log = robot_bag(tmp_path / "in.mcap", 200)
        out = tmp_path / "out.mcap"
        result = run(log, out, changes=["/odom:twist.twist.linear.x = nan where pose.pose.position.x > 1"])
        before, after = raw(log), raw(out)
        assert [each.topic for each in after] == [each.topic for each in before]
        kind = Ros2Adapter().type_named("nav_msgs/msg/Odometry")
        assert kind is not None
        changed = 0
        for old, new in zip(before, after, strict=True):
            if old == new:
                continue
            changed += 1
            assert old.topic == "/odom"
            assert kind.read(old.data, "pose.pose.position.x") > 1
            assert math.isnan(kind.read(new.data, "twist.twist.linear.x"))
            assert new._replace(data=b"") == old._replace(data=b"")
            assert (
                kind.patch(new.data, {"twist.twist.linear.x": kind.read(old.data, "twist.twist.linear.x")}) == old.data
            )
        assert changed == counts(result)["/odom"][1] == 200 - 9
        with AnyReader([out]) as reader:
            assert sum(1 for _ in reader.messages()) == len(before)

    def test_it_is_copied_and_split_into_a_bag(self, tmp_path):
        log = robot_bag(tmp_path / "in.mcap", 2000)
        run(log, tmp_path / "copy.mcap")
        assert raw(tmp_path / "copy.mcap") == raw(log)
        assert chunk_sizes(tmp_path / "copy.mcap")[1:] == chunk_sizes(log)[1:], "the first one has the definitions, too"
        run(log, tmp_path / "bag", split_seconds=10.0, drop=["/tf every 2"])
        with Reader(tmp_path / "bag") as reader:
            assert reader.message_count == len(list(reader.messages())) == 4 + 2000 + 1000

    @pytest.mark.parametrize("options", [{"use_chunking": False}, {"compression": CompressionType.LZ4}])
    def test_however_it_was_written(self, tmp_path, options):
        log = robot_bag(tmp_path / "in.mcap", **options)
        run(log, tmp_path / "out.mcap", sort=True, compression="lz4")
        assert raw(tmp_path / "out.mcap") == sorted(raw(log), key=lambda each: each.time)
        run(log, tmp_path / "bag")
        assert len(raw(tmp_path / "bag" / "bag_0.mcap")) == len(raw(log))
