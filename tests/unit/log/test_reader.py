import io
import struct

import pytest
from mcap.writer import CompressionType, Writer

from riot_bus.log.loss import Loss
from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from tests.bags import LATCHED, STRING_HASH, VOLATILE, write_bag
from tests.robot_bag import robot_bag


def plain(path, messages, **options):
    """A file of somebody else: (topic, time, data) in this order."""
    buffer = io.BytesIO()
    writer = Writer(buffer, **options)
    writer.start(profile="ros2")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channels = {}
    for topic, time, data in messages:
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic], time, data, time + 1, sequence=3)
    writer.finish()
    path.write_bytes(buffer.getvalue())
    return path


def test_foreign_file_has_topics_as_keys_and_times_as_given(tmp_path):
    path = plain(tmp_path / "a.mcap", [("/odom", 5, b"x")])
    with LogReader(path) as reader:
        assert list(reader.messages()) == [Message(5, "/odom", b"x", sequence=3, publish_time=6)]
        assert reader.schemas == {"/odom": (Schema("std_msgs/msg/String", "ros2msg", b"string data"), "cdr")}
        assert reader.metadata == {}


@pytest.mark.parametrize("chunking", [True, False])
def test_order_is_time_then_place_in_the_file(tmp_path, chunking):
    times = [(n * 7919) % 101 for n in range(400)]
    written = [("/a" if n % 2 else "/b", time, b"%d" % n) for n, time in enumerate(times)]
    path = plain(tmp_path / "a.mcap", written, chunk_size=300, use_chunking=chunking)
    expected = sorted(written, key=lambda each: each[1])
    assert [(m.key, m.time, m.payload) for m in read_log(path)] == expected


@pytest.mark.parametrize(
    "options", [{"repeat_channels": False}, {"use_statistics": False}, {"compression": CompressionType.LZ4}]
)
def test_summaries_may_lack_things(tmp_path, options):
    path = plain(tmp_path / "a.mcap", [("/a", 9 - n, b"x" * 50) for n in range(10)], chunk_size=100, **options)
    with LogReader(path) as reader:
        assert [message.time for message in reader.messages()] == list(range(10))
        assert not reader.loss


def test_selection(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=200)) as writer:
        for n in range(100):
            writer.write(Message(n, f"rover/{'abc'[n % 3]}", b"x" * 20))
    with LogReader(path) as reader:
        assert [message.time for message in reader.messages(start=10, end=13)] == [10, 11, 12]
        assert {message.key for message in reader.messages(topics=["rover/a", "/rover/b"])} == {"rover/a", "rover/b"}
        assert len(list(reader.messages(topics=["rover/*"]))) == 100
        assert list(reader.messages(topics=["x"])) == []


def test_memory_stays_bounded(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=10_000)) as writer:
        for n in range(2000):
            writer.write(Message(n, "a", b"x" * 1000))
    with LogReader(path) as reader:
        loaded = []
        load = reader._load
        reader._load = lambda block: loaded.append(block.number) or load(block)
        stream = reader.messages()
        next(stream)
        assert len(loaded) == 1
        assert sum(1 for _ in stream) == 1999


def test_damaged_chunk_is_left_out_and_counted(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=200, compression="none")) as writer:
        for n in range(30):
            writer.write(Message(n, "a", b"payload %03d" % n, attachment=b"%d" % n))
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"payload 012")] ^= 1
    path.write_bytes(raw)
    with LogReader(path) as reader:
        messages = list(reader.messages())
        assert list(reader.messages()) == messages
        assert reader.loss == Loss(chunks=1)
        assert 20 < len(messages) < 30
        assert all(message.attachment == b"%d" % message.time for message in messages)


def test_damaged_extras_cost_the_attachment_only(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path) as writer:
        writer.write(Message(1, "a", b"x", attachment=b"y"))
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"\x28\xb5\x2f\xfd") + 8] ^= 1  # the first zstd frame is the extras'
    path.write_bytes(raw)
    with LogReader(path) as reader:
        assert list(reader.messages()) == [Message(1, "a", b"x")]
        assert reader.loss == Loss(details=1)


def test_cut_chunk_is_read_as_far_as_it_goes(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, LogSettings(compression="none")) as writer:
        for n in range(30):
            writer.write(Message(n, "a", b"payload %03d" % n))
    raw = path.read_bytes()
    path.write_bytes(raw[: raw.index(b"payload 020")])
    with LogReader(path) as reader:
        assert len(list(reader.messages())) == 20
        assert reader.loss.unfinished
        assert reader.loss.bytes > 0
        assert "not closed" in str(reader.loss)


def test_hostile_sizes_do_not_take_the_memory(tmp_path):
    path = plain(tmp_path / "a.mcap", [("/a", 1, b"x")])
    raw = bytearray(path.read_bytes())
    at = raw.index(b"zstd")
    raw[at - 16 : at - 8] = struct.pack("<Q", 1 << 60)  # uncompressed size
    path.write_bytes(raw)
    with LogReader(path) as reader:
        assert list(reader.messages()) == []
        assert reader.loss.chunks == 1


@pytest.mark.parametrize(
    ("content", "problem"), [(b"", "empty"), (b"SQLite format 3", "not an MCAP"), (b"\x89MC", "not an MCAP")]
)
def test_what_is_not_mcap_is_refused(tmp_path, content, problem):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=problem) as caught:
        LogReader(path)
    assert caught.value.hint


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(ConfigError, match="cannot read"):
        LogReader(tmp_path / "none.mcap")
    with pytest.raises(ConfigError, match="no regular file"):
        LogReader(tmp_path)


def test_a_bag_of_a_robot(tmp_path):
    with LogReader(robot_bag(tmp_path / "bag.mcap")) as reader:
        messages = list(reader.messages())
        assert len(messages) == 4 + 2 * 50
        assert not reader.loss
        assert {message.key for message in messages} <= set(reader.schemas)
    times = [message.time for message in messages]
    assert times == sorted(times)


def test_topics_of_a_bag(tmp_path):
    topics = {"/map": (LATCHED, STRING_HASH), "/odom": (VOLATILE, "")}
    with LogReader(write_bag(tmp_path / "bag.mcap", topics, [(5, "/map", "x"), (9, "/odom", "y")])) as reader:
        first, second = reader.recorded_topics()
        assert reader.span() == (5, 9)
    assert (first.name, first.key, first.keyed, first.encoding) == ("/map", "/map", False, "cdr")
    assert (first.schema.name, first.schema.encoding, first.schema.data) == (
        "std_msgs/msg/String",
        "ros2msg",
        b"string data\n",
    )
    assert first.details == {"offered_qos_profiles": LATCHED, "topic_type_hash": STRING_HASH}
    assert second.name == "/odom"


def test_a_topic_of_several_channels_is_one(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = [writer.register_channel("a", encoding, 0) for encoding in ("json", "cbor")]
        for time, channel in enumerate(channels):
            writer.add_message(channel, time, b"", time)
        writer.finish()
    with LogReader(path) as reader:
        (topic,) = reader.recorded_topics()
        assert (topic.encoding, topic.schema.name) == ("json", "")
        assert reader.span() == (0, 1)


def test_originals_are_no_topics_and_begin_no_log(tmp_path):
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.write(Message(1, "b", b"[]"), role="original")
        writer.write(Message(3, "a", b"[]"))
    with LogReader(tmp_path / "log.mcap") as reader:
        assert [topic.key for topic in reader.recorded_topics()] == ["a"]
        assert reader.span() == (3, 3)


def test_an_empty_log(tmp_path):
    with LogWriter(tmp_path / "log.mcap"):
        pass
    with LogReader(tmp_path / "log.mcap") as reader:
        assert (reader.recorded_topics(), reader.span()) == ([], None)
