from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.log.rosbag2 import RECORD, BagFile, BagTopic, bag_file, bag_record, bag_text, files_of, write_metadata
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
KEY = f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
SECOND = 10**9


def write_bag(folder: Path, *parts: int) -> list[BagFile]:
    """A bag of so many messages in each file."""
    folder.mkdir()
    files, number = [], 0
    for place, count in enumerate(parts):
        name = f"{folder.name}_{place}.mcap"
        with LogWriter(folder / name, registry=TypeRegistry(load_adapters()), profile="ros2") as writer:
            for _ in range(count):
                text = b"%03d" % number
                writer.write(Message(SECOND * (number + 1), KEY, b"\0\1\0\0\4\0\0\0" + text + b"\0", sequence=number))
                number += 1
            writer.flush()
            files.append(bag_file(name, writer))
            writer.note(RECORD, bag_record(files[-1]))
    write_metadata(folder, files)
    return files


def test_rosbags_reads_all_files_of_a_bag(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    files = write_bag(tmp_path / "bag", 3, 2)
    assert [each.messages for each in files] == [3, 2]
    with highlevel.AnyReader([tmp_path / "bag"]) as bag:
        read = [bag.deserialize(raw, each.msgtype).data for each, _, raw in bag.messages()]
        assert bag.message_count == 5
        assert (bag.start_time, bag.end_time) == (SECOND, 5 * SECOND + 1)
        assert bag.topics["/chatter"].msgtype == "std_msgs/msg/String"
        assert bag.topics["/chatter"].msgcount == 5
    assert read == ["000", "001", "002", "003", "004"]


def test_rosbags_reads_an_empty_bag(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    write_bag(tmp_path / "bag", 0)
    with highlevel.AnyReader([tmp_path / "bag"]) as bag:
        assert bag.message_count == 0


def test_texts_are_quoted() -> None:
    topic = BagTopic('/odd"name\n', "a/msg/B", "cdr", "- history: 1\n", "", 2)
    text = bag_text([BagFile("b: #.mcap", [topic], 5, 9)])
    assert '        name: "/odd\\"name\\n"\n' in text
    assert '    - "b: #.mcap"\n' in text
    assert "    nanoseconds: 4\n" in text
    assert text.count("message_count: 2") == 3


def test_a_folder_is_its_files_in_the_order_of_their_numbers(tmp_path):
    for name in ("bag_10.mcap", "bag_2.mcap", "bag_1.mcap", "metadata.yaml", "7.mcap"):
        (tmp_path / name).touch()
    (tmp_path / "folder.mcap").mkdir()
    assert [file.name for file in files_of(tmp_path)] == ["7.mcap", "bag_1.mcap", "bag_2.mcap", "bag_10.mcap"]
    assert files_of(tmp_path / "none.mcap") == [tmp_path / "none.mcap"]
    with pytest.raises(ConfigError, match=r"no \.mcap files"):
        files_of(tmp_path / "folder.mcap")
