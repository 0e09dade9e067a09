from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control.recordings import Recordings
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.reader import LogReader, read_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message


class FakeBus:
    """A bus that is handed recorders."""

    sessions: dict[str, Any] = {}  # noqa: RUF012
    intercepted = ("cut/*",)

    def __init__(self) -> None:
        self.recorders: list[Any] = []
        self.renewed = 0

    def set_recorder(self, recorder: Any) -> None:
        self.recorders.append(recorder)

    def renew(self) -> None:
        self.renewed += 1


@pytest.fixture
def bus() -> FakeBus:
    return FakeBus()


@pytest.fixture
def recordings(bus: FakeBus, tmp_path: Path) -> Recordings:
    return Recordings(
        lambda: bus,  # type: ignore[arg-type,return-value]
        registry=TypeRegistry(),
        folder=tmp_path,
        name="router",
        metadata=lambda: {"seed": "7"},
        profile=None,
    )


def test_a_recording_is_begun_split_and_ended(bus: FakeBus, recordings: Recordings, tmp_path: Path) -> None:
    assert recordings.status() is None
    path = recordings.start("a.mcap")
    (recorder,) = bus.recorders
    for number in range(3):
        recorder.delivered(Message(number, "k", b""))
    assert recordings.split() == (path, tmp_path / "a-2.mcap")
    recorder.delivered(Message(9, "k", b""))
    former, figures = recordings.stop()
    recordings.settle()
    recordings.close()
    assert (former, figures["messages"], figures["lost"], figures["problem"]) == (tmp_path / "a-2.mcap", 1, 0, "")
    assert bus.recorders == [recorder, None]
    assert ([m.time for m in read_log(path)], [m.time for m in read_log(former)]) == ([0, 1, 2], [9])
    with LogReader(former) as reader:
        assert reader.metadata["seed"] == "7"
        assert [account_of(each) for each in reader.notes(LOST)] == [Account({"k": 1})]


def test_there_is_one_recording_at_a_time(recordings: Recordings) -> None:
    with pytest.raises(ConfigError, match="does not record"):
        recordings.split()
    with pytest.raises(ConfigError, match="does not record"):
        recordings.stop()
    recordings.start("a.mcap")
    with pytest.raises(ConfigError, match="recording already"):
        recordings.start("b.mcap")
    recordings.close()


def test_one_that_is_ended_before_it_has_begun_is_told(bus: FakeBus, recordings: Recordings) -> None:
    def stop(recorder: Any) -> None:
        bus.recorders.append(recorder)
        if recorder is not None:
            recordings.stop()

    bus.set_recorder = stop  # type: ignore[method-assign]
    with pytest.raises(EnvironmentFaultError, match="before it had begun"):
        recordings.start("a.mcap")
    assert bus.recorders[-1] is None


def test_a_type_that_is_learnt_is_used_by_bus_and_file(bus: FakeBus, recordings: Recordings) -> None:
    assert (recordings._wanted("cut/x"), recordings._wanted("k")) == (True, False)
    recordings.start("a.mcap")
    assert recordings._wanted("k")
    renewed: list[str] = []
    recordings._recorder = SimpleNamespace(renew=renewed.append, close=lambda: None)  # type: ignore[assignment]
    recordings._learnt("k")
    assert (bus.renewed, renewed) == (1, ["k"])
    bus.recorders[0].close()


def test_the_graph_is_noted_in_each_file(recordings: Recordings, tmp_path: Path) -> None:
    assert not recordings._write_note("riot_bus.graph", {})
    recordings.start("a.mcap")
    assert recordings._write_note("riot_bus.graph", {"a": "b"})
    recordings.close()
    with LogReader(tmp_path / "a.mcap") as reader:
        assert list(reader.notes("riot_bus.graph")) == [{"a": "b"}]
