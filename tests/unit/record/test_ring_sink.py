from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.account import Account
from riot_bus.log.engine.ring import RingContent
from riot_bus.log.reader import LogReader
from riot_bus.record.ring_sink import RingSink
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from tests.unit.record.sink_tools import common, numbers, put


def open_sink(said: list[str], folder: Path, **options: Any) -> RingSink:
    more = common(said, output=folder / "a.mcap", ring_seconds=60.0, **options)
    return RingSink(more.pop("options"), notes=lambda: [("riot_bus.graph", {"a": "b"})], **more)


def test_a_file_holds_what_the_ring_held(tmp_path: Path) -> None:
    sink = open_sink([], tmp_path)
    with pytest.raises(ConfigError, match="nothing has been recorded"):
        sink.dump()
    assert sink.path is None
    put(sink, 1, 2)
    assert sink.dump() == sink.path == tmp_path / "a.mcap"
    put(sink, 3)
    assert sink.dump() == tmp_path / "a-2.mcap"
    sink.close()
    assert (numbers(tmp_path / "a.mcap"), numbers(tmp_path / "a-2.mcap")) == ([1, 2], [1, 2, 3])
    with LogReader(tmp_path / "a.mcap") as reader:
        assert (reader.metadata["robot"], list(reader.notes("riot_bus.graph"))) == ("r", [{"a": "b"}])
    assert [each.account for each in sink.files()] == [Account({"a/x": 2}), Account({"a/x": 3})]
    assert sink.account() == Account({"a/x": 3})


def test_what_it_holds_is_told(tmp_path: Path) -> None:
    sink = open_sink([], tmp_path)
    put(sink, 1, 2)
    sink.writer.flush()
    sink.tick()
    found = sink.status()
    assert (found["file"], found["problem"], found["ring"]["messages"], found["ring"]["cut"]) == ("", "", 2, False)
    with pytest.raises(ConfigError, match="no file to be split"):
        sink.split()
    sink.close()


def test_only_the_newest_files_are_kept(tmp_path: Path) -> None:
    sink = open_sink([], tmp_path, max_files=1)
    put(sink, 1)
    for _ in range(3):
        sink.dump()
    sink.close()
    assert [each.name for each in tmp_path.iterdir()] == ["a-3.mcap"]
    assert [each.deleted for each in sink.files()] == [True, True, False]


def test_a_ring_that_cannot_be_written_is_an_alarm_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object, **more: object) -> int:
        raise OSError(28, "No space left on device")

    said: list[str] = []
    sink = open_sink(said, tmp_path)
    put(sink, 1, 2)
    with monkeypatch.context() as patch:
        patch.setattr(RingContent, "write", full)
        with pytest.raises(EnvironmentFaultError, match="No space left"):
            sink.dump()
    assert said[0].startswith("ALARM")
    assert "2 messages are not in a file" in said[0]
    assert (sink.account().lost, sink.problem != "") == ({"disk": {"a/x": 2}}, True)
    sink.dump()
    assert sink.problem == ""
    sink.close()


def test_a_bag_lists_what_was_written(tmp_path: Path) -> None:
    more = common([], output=tmp_path / "bag", bag=True, ring_seconds=60.0)
    sink = RingSink(more.pop("options"), notes=list, **{**more, "profile": "ros2"})
    put(sink, 1)
    sink.dump()
    sink.close()
    assert "bag_0.mcap" in (tmp_path / "bag" / "metadata.yaml").read_text()
