from mcap.writer import Writer

from riot_bus.log.channels import recorded_topics, span_of
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from tests.bags import LATCHED, STRING_HASH, VOLATILE, write_bag


def test_topics_of_a_bag(tmp_path):
    topics = {"/map": (LATCHED, STRING_HASH), "/odom": (VOLATILE, "")}
    with LogReader(write_bag(tmp_path / "bag.mcap", topics, [(5, "/map", "x"), (9, "/odom", "y")])) as reader:
        first, second = recorded_topics(reader)
        assert span_of(reader) == (5, 9)
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
        (topic,) = recorded_topics(reader)
        assert (topic.encoding, topic.schema.name) == ("json", "")
        assert span_of(reader) == (0, 1)


def test_originals_are_no_topics_and_begin_no_log(tmp_path):
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.write(Message(1, "b", b"[]"), role="original")
        writer.write(Message(3, "a", b"[]"))
    with LogReader(tmp_path / "log.mcap") as reader:
        assert [topic.key for topic in recorded_topics(reader)] == ["a"]
        assert span_of(reader) == (3, 3)


def test_an_empty_log(tmp_path):
    with LogWriter(tmp_path / "log.mcap"):
        pass
    with LogReader(tmp_path / "log.mcap") as reader:
        assert (recorded_topics(reader), span_of(reader)) == ([], None)
