import threading

import pytest

from riot_bus.interceptors.payloads import SetField
from riot_bus.interceptors.record import Record
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def recorded(path):
    with LogReader(path) as reader:
        return [(message.key, message.payload) for message in reader.messages()], reader.loss


def test_messages_are_recorded_as_they_are_at_its_place(tmp_path, bench):
    before, after = Record(str(tmp_path / "before.mcap")), Record(str(tmp_path / "after.mcap"))
    run = bench(before, SetField("x", 2.5), after)
    run.feed_all([0.0, 0.1, 0.2])
    run.pipeline.close()
    for interceptor, payload in ((before, b'{"x": 1.5}'), (after, b'{"x": 2.5}')):
        found, loss = recorded(interceptor.path)
        assert found == [("a", payload)] * 3
        assert not loss
        assert (interceptor.recorded, interceptor.lost) == (3, {})


@pytest.fixture
def stuck(monkeypatch):
    """A disk that takes nothing until the event is set."""
    free = threading.Event()
    write = LogWriter.write

    def slow(self, message, **more):
        assert free.wait(60)
        write(self, message, **more)

    monkeypatch.setattr(LogWriter, "write", slow)
    yield free
    free.set()


@pytest.mark.parametrize("bound", [{"capacity": 5}, {"capacity_bytes": 5 * (10 + 256)}])
def test_what_does_not_fit_is_counted_and_shown_and_goes_on(tmp_path, stuck, bound):
    record = Record(str(tmp_path / "log.mcap"), **bound)
    pipeline = Pipeline([record], registry=TypeRegistry())
    results = [pipeline.feed(Message(n, "ab"[n % 2], b'{"x": 1.5}')) for n in range(100)]
    assert all(result.emissions[0].message is result.original for result in results)
    assert pipeline.errors["record"].count == 1
    assert "messages are not recorded" in pipeline.errors["record"].first
    stuck.set()
    pipeline.close()
    found, _ = recorded(record.path)
    assert len(found) == record.recorded == 100 - record.lost.total()
    assert 5 <= record.recorded <= 10
    assert set(record.lost) == {"a", "b"}
    assert pipeline.errors["record"].count == 2


def test_a_disk_that_refuses_is_a_counted_loss(tmp_path, monkeypatch, caplog):
    def refuse(self, message, **more):
        raise OSError("disk full")

    monkeypatch.setattr(LogWriter, "write", refuse)
    record = Record(str(tmp_path / "log.mcap"))
    pipeline = Pipeline([record], registry=TypeRegistry())
    for n in range(10):
        pipeline.feed(Message(n, "a", b"{}"))
    pipeline.close()
    assert record.lost == {"a": 10}
    assert record.recorded == 0
    assert pipeline.errors["record"].count >= 1
    assert caplog.text.count("the recording failed") == 1


def test_what_an_mcap_file_cannot_hold_is_lost_too(tmp_path):
    record = Record(str(tmp_path / "log.mcap"))
    pipeline = Pipeline([record], registry=TypeRegistry())
    for time in (-1, 1):
        pipeline.feed(Message(time, "a", b"{}"))
    pipeline.close()
    assert (record.recorded, record.lost) == (1, {"a": 1})


def test_a_file_that_cannot_be_opened_is_an_error_and_every_message_a_loss(tmp_path):
    record = Record(str(tmp_path / "none" / "log.mcap"))
    pipeline = Pipeline([record], registry=TypeRegistry())
    result = pipeline.feed(Message(0, "a", b"{}"))
    assert result.emissions
    assert "cannot write the log" in pipeline.errors["record"].first
    assert record.lost == {"a": 1}


def test_stop_without_start(tmp_path):
    Record(str(tmp_path / "log.mcap")).stop()


def test_bounds_are_above_zero():
    with pytest.raises(ConfigError, match="1 or more"):
        Record("x.mcap", capacity=0)
