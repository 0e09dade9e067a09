from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from riot_bus.interceptors.recorder import Recorder
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until


class Memory:
    problem = ""
    refused = 0
    account: Account | None = None

    def __init__(self) -> None:
        self.rows: list[str] = []
        self.closed = threading.Event()

    def write(self, message: Message, *, role: str = "delivered", changes: Any = ()) -> None:
        assert not self.closed.is_set()
        self.rows.append(message.key)

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        if name == LOST:
            self.account = account_of(mapping)
        else:
            self.rows.append(name)

    def tick(self) -> None:
        pass

    def flush(self) -> None:
        pass

    def close(self) -> None:
        self.closed.set()


def totals(recorder: Recorder) -> tuple[int, int]:
    return sum(recorder.recorded.values()), recorder.lost.total()


def test_a_switch_leaves_each_message_in_one_file() -> None:
    first, second = Memory(), Memory()
    recorder = Recorder(first)
    keys = [str(number) for number in range(5000)]
    feeding = threading.Thread(target=lambda: [recorder.delivered(Message(1, key, b"")) for key in keys])
    feeding.start()
    recorder.switch(second)
    assert first.closed.is_set()
    feeding.join()
    recorder.close()
    assert first.rows + second.rows == keys
    assert totals(recorder) == (5000, 0)
    accounts = [each.account for each in (first, second)]
    assert [sum(each.recorded.values()) for each in accounts if each is not None] == [len(first.rows), len(second.rows)]


class Slow(Memory):
    def write(self, message: Message, *, role: str = "delivered", changes: Any = ()) -> None:
        super().write(message)
        self.closed.wait(0.01)


def test_a_switch_does_not_wait_for_ever_for_what_comes_too_fast() -> None:
    first, second = Slow(), Memory()
    recorder = Recorder(first)
    keys = [str(number) for number in range(3000)]
    for key in keys:
        recorder.delivered(Message(1, key, b""))
    began = time.monotonic()
    recorder.switch(second, patience=0.1)
    assert time.monotonic() - began < 15  # all of it would take twice as long
    assert first.account == Account(dict.fromkeys(first.rows, 1))
    recorder.switch(Memory(), patience=60)
    assert totals(recorder) == (3000, 0)
    assert recorder.present() == Account()
    recorder.close()
    assert first.rows + second.rows == keys


def test_a_switch_needs_no_room_among_the_messages() -> None:
    first, second = Memory(), Memory()
    recorder = Recorder(first, capacity=0)
    recorder.switch(second)
    assert first.closed.is_set()
    recorder.close()
    assert second.closed.is_set()


def test_notes_are_in_their_place_among_the_messages() -> None:
    memory = Memory()
    recorder = Recorder(memory)
    recorder.delivered(Message(1, "a", b""))
    assert recorder.note("riot_bus.graph", {"a": "b"})
    recorder.delivered(Message(1, "b", b""))
    recorder.close()
    assert memory.rows == ["a", "riot_bus.graph", "b"]


def test_what_does_not_fit_is_counted() -> None:
    memory = Memory()
    recorder = Recorder(memory, capacity=0)
    recorder.delivered(Message(1, "a", b""))
    assert not recorder.note("n", {})
    recorder.close()
    assert totals(recorder) == (0, 1)
    assert memory.account == Account(lost={"no room": {"a": 1}})


def test_what_a_broken_file_lost_is_counted_and_the_next_file_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    recorder = Recorder(LogWriter(tmp_path / "a.mcap", LogSettings(chunk_seconds=0.1, threaded=True)))
    with monkeypatch.context() as patch:
        patch.setattr(McapFile, "chunk", full)
        for key in ("a", "a", "b"):
            recorder.delivered(Message(1, key, b""))
        recorder.original(Message(1, "b", b""), ())
        assert wait_until(lambda: totals(recorder) == (0, 4), 10)
    assert recorder.lost == {"a": 2, "b": 2}
    assert "No space left on device" in recorder.problem
    recorder.switch(LogWriter(tmp_path / "b.mcap"))
    assert (totals(recorder), recorder.lossy) == ((0, 4), True)
    assert recorder.problem == ""
    recorder.delivered(Message(1, "d", b""))
    recorder.close()
    assert totals(recorder) == (1, 4)
    with LogReader(tmp_path / "b.mcap") as reader:
        assert [message.key for message in reader.messages()] == ["d"]
    assert len(caplog.records) == 1
    for name, expected in (("a", Account(lost={"disk": {"a": 2, "b": 2}})), ("b", Account({"d": 1}))):
        with LogReader(tmp_path / f"{name}.mcap") as reader:
            assert [account_of(each) for each in reader.notes(LOST)] == [expected]
