"""Destination of a recording that keeps only the last seconds, and writes them only on request."""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.log import layout
from riot_bus.log.account import LOST
from riot_bus.log.engine.ring import Ring
from riot_bus.log.recorded_file import RecordedFile
from riot_bus.log.rosbag2 import RECORD, BagFile, bag_of, bag_record, write_metadata
from riot_bus.log.writer import LogWriter
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.record.recording_sink import RecordingSink
from riot_bus.record.rotating_sink import FileResult
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.account import Account
    from riot_bus.log.engine.ring import RingContent
    from riot_bus.record.options import CaptureOptions


class RingSink(RecordingSink):
    """Sink that keeps messages in memory; `counts` include what the ring has dropped as recorded."""

    def __init__(
        self, options: CaptureOptions, *, notes: Callable[[], Sequence[tuple[str, Mapping[str, str]]]], **more: Any
    ) -> None:
        super().__init__(options, **more)
        self.problem = ""
        self._notes = notes
        self._ring = Ring(options.ring_seconds, most_bytes=options.ring_bytes, compression=options.compression)
        # Chunks are dropped as a whole, so they must be short compared with the ring.
        age = min(options.chunk_seconds, options.ring_seconds / 10)
        settings = replace(self._settings, chunk_seconds=age, durable=False)
        self._use(self._new_file(RecordedFile[LogWriter], "ring", settings, storage=self._ring))
        self._files: list[FileResult] = []
        self._bag: list[BagFile] = []
        self._dumping = threading.Lock()

    @property
    def path(self) -> Path | None:
        """The last file, None if there is none."""
        return Path(self._files[-1].path) if self._files else None

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Do nothing: what `notes` returns is written with the ring."""

    def tick(self) -> None:
        """End chunks by age; call it several times a second."""
        self._file.attempt(self.writer.tick)

    def split(self, text: str | None = None) -> tuple[Path, Path]:
        """Raise ConfigError: there is no file to split."""
        raise ConfigError("there is no file to be split", where="record/split", hint="write the ring: dump")

    def dump(self, text: str | None = None) -> Path:
        """Write the ring to a file; recording continues meanwhile.

        Raises:
            ConfigError: It is refused, or nothing is kept.
            EnvironmentFaultError: The disk is full or has failed.
        """
        with self._dumping:
            with suppress(LostMessagesError):  # it concerns earlier messages
                self.writer.flush()
            content = self._ring.content()
            if not content.messages:
                raise ConfigError("nothing has been recorded yet", where="record/dump")
            path = self._naming.next(text)
            schemas, channels = self.writer.definitions()
            file = bag_of(path.name, channels, schemas, content.messages, content.start, content.end)
            recorded = self._by_topic(content)
            account = replace(self.counts.account(), recorded=recorded)
            after = [(RECORD, bag_record(file))] if self._profile == "ros2" else []
            try:
                size = content.write(
                    path,
                    library=layout.LIBRARY,
                    profile=self._profile,
                    schemas=schemas,
                    channels=channels,
                    notes=[(layout.RUN, self._metadata()), *self._notes()],
                    after=[*after, (LOST, account.record())],
                )
            except OSError as error:
                self._unwritten(recorded, path, error)
                raise EnvironmentFaultError(self.problem, where=str(path), hint="make room and dump again") from error
            self.problem = ""
            self._files.append(FileResult(str(path), size, account))
            self._bag.append(file)
            self._forget_oldest()
            if self._naming.bag:
                write_metadata(self._naming.folder, self._bag)
            return path

    def close(self) -> None:
        """Close the ring, and discard what it holds."""
        with suppress(LostMessagesError):
            self.writer.close()

    def account(self) -> Account:
        """Return the counts since the beginning."""
        return self._file.account()

    def files(self) -> list[FileResult]:
        """Return the files, the oldest first."""
        return list(self._files)

    def status(self) -> dict[str, Any]:
        """Return the state as JSON values."""
        content = self._ring.content()
        return {
            "file": str(self.path or ""),
            "bytes": self._ring.size,
            "waiting_bytes": self.writer.queued_bytes,
            "problem": self.problem,
            "ring": {
                "messages": sum(content.messages.values()),
                "seconds": (content.end - content.start) / 1e9,
                "cut": self._ring.cut,
            },
        }

    def _by_topic(self, content: RingContent) -> dict[str, int]:
        _, channels = self.writer.definitions()
        topics = {each.id: each.metadata.get(layout.TOPIC, each.topic) for each in channels}
        found = Counter[str]()
        for channel, count in content.messages.items():
            found[topics[channel]] += count
        return found

    def _forget_oldest(self) -> None:
        most = self._options.max_files
        for place, each in enumerate(self._files[: max(0, len(self._files) - most)] if most else ()):
            with suppress(OSError):
                os.unlink(each.path)
                self._files[place] = replace(each, deleted=True)
            self._bag = [file for file in self._bag if file.name != Path(each.path).name]

    def _unwritten(self, recorded: Mapping[str, int], path: Path, error: OSError) -> None:
        self.problem = f"the ring cannot be written: {error.strerror}"
        with self.lock:
            for topic, number in recorded.items():
                self.counts.lose("disk", topic, number)
        stamp = time.strftime("%H:%M:%S")
        self._warn(f"ALARM: {stamp}: {self.problem}: {path}: {sum(recorded.values())} messages are not in a file")
