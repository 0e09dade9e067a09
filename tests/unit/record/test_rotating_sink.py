from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.reader import LogReader
from riot_bus.record import rotating_sink as module
from riot_bus.record.rotating_sink import RotatingSink
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.record.sink_tools import common, numbers, put


def open_sink(said: list[str], **options: Any) -> RotatingSink:
    more = common(said, **options)
    return RotatingSink(more.pop("options"), began=lambda: said.append("began"), **more)


def account(path: Path) -> Account | None:
    with LogReader(path) as reader:
        return account_of(list(reader.notes(LOST))[-1])


def test_each_message_is_in_one_of_two_files(tmp_path: Path) -> None:
    said: list[str] = []
    sink = open_sink(said, output=tmp_path / "a.mcap")
    put(sink, 1, 2)
    assert sink.split() == (tmp_path / "a.mcap", tmp_path / "a-2.mcap")
    put(sink, 3)
    sink.close()
    sink.close()
    assert (numbers(tmp_path / "a.mcap"), numbers(tmp_path / "a-2.mcap")) == ([1, 2], [3])
    assert (account(tmp_path / "a.mcap"), sink.account()) == (Account({"a/x": 2}), Account({"a/x": 3}))
    assert [each.row()["messages"] for each in sink.files()] == [2, 1]
    assert (said, sink.generation, sink.path.name) == (["began"], 1, "a-2.mcap")


def test_files_are_split_by_size_and_age(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sink = open_sink([], output=tmp_path / "a.mcap", split_bytes=1, split_seconds=3600)
    sink.tick()
    assert sink.path.name == "a-2.mcap"
    later = module.time.monotonic() + 4000
    monkeypatch.setattr(module.time, "monotonic", lambda: later)
    sink.tick()
    assert sink.path.name == "a-3.mcap"
    sink.close()


def test_only_the_newest_files_are_kept(tmp_path: Path) -> None:
    sink = open_sink([], output=tmp_path / "a.mcap", max_files=2, split_seconds=3600)
    for number in range(4):
        put(sink, number)
        sink.split()
    sink.close()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a-4.mcap", "a-5.mcap"]
    assert [each.deleted for each in sink.files()] == [True, True, True, False, False]


def test_a_name_that_is_taken_leaves_the_present_file(tmp_path: Path) -> None:
    sink = open_sink([], output=tmp_path / "a.mcap")
    (tmp_path / "b.mcap").touch()
    with pytest.raises(ConfigError, match="exists"):
        sink.split("b.mcap")
    assert sink.path == tmp_path / "a.mcap"
    sink.close()


def test_a_bag_lists_its_files(tmp_path: Path) -> None:
    sink = open_sink([], output=tmp_path / "bag", bag=True)
    put(sink, 1)
    sink.split()
    sink.close()
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "bag_0.mcap" in text
    assert "message_count: 1" in text


def failing(monkeypatch: pytest.MonkeyPatch, number: int) -> pytest.MonkeyPatch:
    def fail(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(McapFile, "chunk", fail)
    return monkeypatch


def test_a_full_disk_is_reported_counted_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    sink = open_sink(said, output=tmp_path / "a.mcap")
    with monkeypatch.context() as patch:
        failing(patch, errno.ENOSPC)
        put(sink, 1, 2)
        sink._file.attempt(sink.writer.flush)
        sink.tick()
    assert "No space left" in sink.problem
    assert [line for line in said if line.startswith("ALARM")] == [said[0]]
    assert sink.account() == Account({}, {"disk": {"a/x": 2}})
    assert sink.path == tmp_path / "a.mcap"  # another file would be empty, too
    put(sink, 3)
    sink._file.attempt(sink.writer.flush)
    sink.tick()
    assert "written again" in said[-1]
    sink.close()
    assert account(tmp_path / "a.mcap") == Account({"a/x": 1}, {"disk": {"a/x": 2}})


def test_another_file_is_tried_where_that_may_help(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    sink = open_sink(said, output=tmp_path / "a.mcap")
    with monkeypatch.context() as patch:
        failing(patch, errno.EFBIG)
        put(sink, 1)
        sink._file.attempt(sink.writer.flush)
        sink.tick()
    assert sink.path == tmp_path / "a-2.mcap"
    put(sink, 2)
    sink.close()
    assert numbers(tmp_path / "a-2.mcap") == [2]


def test_a_fault_of_the_program_is_not_taken_for_one_of_the_disk(tmp_path: Path) -> None:
    sink = open_sink([], output=tmp_path / "a.mcap")
    with pytest.raises(ZeroDivisionError):
        sink._file.attempt(lambda: 1 // 0)
    sink.close()
