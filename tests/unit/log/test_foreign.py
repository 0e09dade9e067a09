from riot_bus.log.foreign import bus_messages
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_ros2.attachment import parse_attachment
from tests.bags import STRING_HASH, STRING_KEY, VOLATILE, write_bag


def read(path, adapters=("ros2",)):
    with LogReader(path) as reader:
        return list(bus_messages(reader, TypeRegistry(load_adapters(list(adapters)))))


def test_a_bag_is_as_if_it_came_from_the_bus(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "3")
    topics = {"/a": (VOLATILE, STRING_HASH), "/b/c": (VOLATILE, STRING_HASH)}
    bag = write_bag(tmp_path / "bag.mcap", topics, [(5, "/a", "x"), (6, "/b/c", "y"), (7, "/a", "z")])
    found = read(bag)
    assert [(m.time, m.key, m.payload[8:9]) for m in found] == [
        (5, f"3/a/{STRING_KEY}", b"x"),
        (6, f"3/b/c/{STRING_KEY}", b"y"),
        (7, f"3/a/{STRING_KEY}", b"z"),
    ]
    first, other, second = (parse_attachment(message.attachment) for message in found)
    assert [(each.sequence, each.source_time) for each in (first, other, second)] == [(1, 5), (1, 6), (2, 7)]
    assert first.gid == second.gid != other.gid
    assert [message.sequence for message in found] == [0, 1, 2]
    assert read(bag) == found


def test_other_files_without_keys(tmp_path):
    bag = write_bag(tmp_path / "bag.mcap", {"/a/": (VOLATILE, "")}, [(5, "/a/", "x")])
    (message,) = read(bag, adapters=())
    assert (message.key, message.attachment) == ("a", None)


def test_what_has_keys_is_left_as_it_is(tmp_path):
    log = [Message(1, f"0/a/{STRING_KEY}", b"x", attachment=b"any"), Message(2, "b", b"y")]
    with LogWriter(tmp_path / "log.mcap") as writer:
        for message in log:
            writer.write(message)
    assert read(tmp_path / "log.mcap") == log
