"""Destination of a recording: successive files, each with its own counts; disk failures are reported and retried."""

from __future__ import annotations

import errno
import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.log.account import Account
from riot_bus.log.recorded_file import RecordedFile
from riot_bus.log.rosbag2 import BagFile, bag_epilogue, bag_file, write_metadata
from riot_bus.log.writer import LogWriter
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.record.recording_sink import RecordingSink
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.record.options import CaptureOptions

_AGAIN_S = 5.0  # each attempt may leave a file: a failing disk gets 12 a minute
_NOTE_S = 1.0  # a note has counts of all topics; a crash costs the last second's losses
_REPEAT_S = 10.0  # a lasting problem stays visible without filling the terminal
_SLOW = 0.5  # share of `queue_bytes` at which a warning still comes before messages are lost
_NO_USE = (errno.ENOSPC, errno.EDQUOT)  # another file on a full disk would be empty


@dataclass(frozen=True, slots=True)
class FileResult:
    """A file of a recording: its path, its size in bytes, what is in it, and whether `max_files` has removed it."""

    path: str
    size: int
    account: Account
    deleted: bool = False

    def row(self) -> dict[str, Any]:
        """Return it as JSON values."""
        recorded = sum(self.account.recorded.values())
        row = {"path": self.path, "bytes": self.size, "messages": recorded, "lost": self.account.total()}
        return {**row, "deleted": True} if self.deleted else row


class _LogFile(RecordedFile[LogWriter]):
    def __init__(self, writer: LogWriter, **more: Any) -> None:
        super().__init__(writer, **more)
        self.path = Path(writer.path)
        self.finished: FileResult | None = None
        self.began = time.monotonic()
        self.noted = 0
        self.noted_at = 0.0

    def result(self) -> FileResult:
        return self.finished or FileResult(str(self.path), self.writer.size, self.account())


class RotatingSink(RecordingSink):
    """Sink that writes to files; `began` is called, without the lock, when another file has begun."""

    _file: _LogFile

    def __init__(self, options: CaptureOptions, *, began: Callable[[], None], **more: Any) -> None:
        super().__init__(options, **more)
        self._began = began
        self._bag: dict[str, BagFile] = {}
        self._files: list[_LogFile] = []
        self._finishing: list[threading.Thread] = []
        self._problem = ""
        self._said = self._tried = -_REPEAT_S
        self._slow = self._alarmed = self._closed = False
        self._use(self._open(self._naming.next()))

    @property
    def path(self) -> Path:
        """Path of the present file."""
        return self._file.path

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write a metadata record."""
        file = self._file
        file.attempt(lambda: file.writer.note(name, mapping))

    def tick(self) -> None:
        """End chunks by age, begin other files, report problems; call this several times a second."""
        file = self._file
        file.attempt(file.writer.tick)
        self._note_losses(file)
        self._look()
        options = self._options
        too_large = options.split_bytes and file.writer.size >= options.split_bytes
        too_old = options.split_seconds and time.monotonic() - file.began >= options.split_seconds
        if too_large or too_old:
            try:
                self.split()
            except ConfigError as error:
                self._alarm(f"no other file can be begun: {error}")

    def split(self, text: str | None = None) -> tuple[Path, Path]:
        """Continue in another file, and return the former and the new path; each message is in one of the two.

        Raises:
            ConfigError: It is refused, or cannot be written.
        """
        path = self._naming.next(text)
        try:
            file = self._open(path)
        except ConfigError:
            with suppress(OSError):
                path.unlink()
            raise
        with self.lock:
            former = self._file
            self._use(file)
            self.generation += 1
        thread = threading.Thread(target=self._finish, args=(former,), name="riot-finish", daemon=True)
        self._finishing.append(thread)
        thread.start()
        self._began()
        return former.path, path

    def close(self) -> None:
        """Finish all files; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._finish(self._file)
        for thread in self._finishing:
            thread.join()

    @property
    def problem(self) -> str:
        """Why nothing can be written at present; empty as long as all is well."""
        return self._file.writer.problem

    def account(self) -> Account:
        """Return the counts of all files."""
        return Account.total_of([each.account for each in self.files()])

    def files(self) -> list[FileResult]:
        """Return the files, in the order of writing."""
        with self.lock:
            return [each.result() for each in self._files]

    def status(self) -> dict[str, Any]:
        """Return the state of the present file as JSON values."""
        file = self._file
        return {
            "file": str(file.path),
            "bytes": file.writer.size,
            "waiting_bytes": file.writer.queued_bytes,
            "problem": self.problem,
        }

    # -- files --------------------------------------------------------------------------------------------------------

    def _open(self, path: Path) -> _LogFile:
        return self._new_file(
            _LogFile,
            path,
            self._settings,
            metadata=self._metadata(),
            profile=self._profile,
            epilogue=bag_epilogue if self._profile == "ros2" else None,
        )

    def _use(self, file: RecordedFile[LogWriter]) -> None:
        super()._use(file)
        self._files.append(self._file)
        self._write_bag()

    def _finish(self, file: _LogFile) -> None:
        file.finish()
        try:
            size = os.stat(file.path).st_size
        except OSError:
            size = 0
        with self.lock:
            file.finished = FileResult(str(file.path), size, file.account())
            self._bag[file.path.name] = bag_file(file.path.name, file.writer)
            self._forget_oldest()
            self._write_bag()

    def _forget_oldest(self) -> None:
        most = self._options.max_files
        kept = [each for each in self._files if os.path.lexists(each.path)]
        for each in kept[: max(0, len(kept) - most)] if most else ():
            if each.finished is None:
                return  # it is still being finished, and then looked at again
            try:
                os.unlink(each.path)
                each.finished = replace(each.finished, deleted=True)
            except OSError as error:
                self._warn(f"{each.path} cannot be deleted: {error.strerror}")

    def _write_bag(self) -> None:
        if not self._naming.bag:
            return
        names = [each.path.name for each in self._files if os.path.lexists(each.path)]
        try:
            write_metadata(self._naming.folder, [self._bag.get(name, BagFile(name)) for name in names])
        except OSError as error:
            self._warn(f"metadata.yaml cannot be written: {error.strerror}")

    def _note_losses(self, file: _LogFile) -> None:
        """Write losses to the file as they happen, so that they survive a crash."""
        now = time.monotonic()
        if (
            now - file.noted_at >= _NOTE_S
            and (lost := file.account().total()) != file.noted
            and not file.writer.problem
        ):
            file.noted, file.noted_at = lost, now
            file.note_account()

    # -- trouble ------------------------------------------------------------------------------------------------------

    def _failed(self, file: RecordedFile[LogWriter], error: Exception) -> None:
        if not isinstance(error, LostMessagesError):
            raise error
        with self.lock:
            if file is not self._file or self._problem:
                return
            self._problem = error.message
            self._alarm(f"{error.message}: {file.writer.path}: messages are being lost")
            if error.errno == errno.EFBIG:
                self._tried = -_AGAIN_S  # files may not be larger here: another one will do

    def _look(self) -> None:
        """Report whether the problem persists, and try another file where that may help."""
        file, now = self._file, time.monotonic()
        slow = file.writer.queued_bytes > _SLOW * self._options.queue_bytes
        if slow and not self._slow:
            self._alarm(f"the disk is slow: {file.writer.queued_bytes >> 20} MiB wait to be written")
        self._slow = slow
        problem = file.writer.problem
        if not problem:
            if self._problem and self._alarmed:
                self._warn(f"the log is being written again: {file.path}")
            self._problem, self._alarmed = "", False
            return
        self._problem = problem
        self._alarm(f"{problem}: {file.path}: {self.account().total()} messages are lost so far")
        if now - self._tried >= _AGAIN_S and (file.writer.gone or file.writer.errno not in _NO_USE):
            self._tried = now
            try:
                self.split()
            except ConfigError as error:
                self._alarm(f"another file cannot be begun either: {error}")

    def _alarm(self, line: str) -> None:
        """Warn at once, and then at most every few seconds."""
        now = time.monotonic()
        if now - self._said >= _REPEAT_S:
            self._said, self._alarmed = now, True
            self._warn(f"ALARM: {line}")
