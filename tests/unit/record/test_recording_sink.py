from __future__ import annotations

from collections import Counter
from pathlib import Path

from riot_bus.log.reader import LogReader
from riot_bus.log.recorded_file import RecordedFile
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.record.naming import Naming
from riot_bus.record.options import CaptureOptions
from riot_bus.record.recording_sink import RecordingSink
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


class FileSink(RecordingSink):
    """The least that is needed of a sink."""

    def __init__(self, path: Path) -> None:
        options = CaptureOptions(output=path, durable=False)
        super().__init__(
            options,
            registry=TypeRegistry(),
            naming=Naming(options),
            metadata=dict,
            details=lambda key: {},
            profile="",
            warn=print,
        )
        self._use(self._new_file(RecordedFile, path, self._settings))

    def put(self, key: str, payload: bytes) -> None:
        with self.lock:
            track = self.writer.track(Message(1, key, payload))
            assert track is not None
            self.append([(track.number, 1, 1, 1, payload, None)], patient=True)


def test_a_type_that_is_learnt_makes_earlier_tracks_invalid(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / "a.mcap")
    sink.put("a/x", b"1")
    sink.renew("a/x")
    assert sink.generation == 1
    sink.put("a/x", b"2")
    sink.writer.close()
    with LogReader(tmp_path / "a.mcap") as reader:
        assert [message.payload for message in reader.messages()] == [b"1", b"2"]


def test_what_a_writer_has_lost_is_counted_as_recorded_before(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / "a.mcap")
    sink.counts.recorded.add("a/x", 5)
    sink._file.fail(LostMessagesError("No space", where="a.mcap", lost=Counter({("a/x", "delivered"): 2})))
    account = sink.counts.account()
    assert (account.recorded, account.lost) == ({"a/x": 3}, {"disk": {"a/x": 2}})
    sink.writer.close()
