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

from riot_bus.log.account import LOST, Account
from riot_bus.log.rosbag2 import BagFile, bag_epilogue, bag_file, write_metadata
from riot_bus.log.writer import LogWriter, LostMessagesError
from riot_bus.record.loss_counts import LossCounts, summed
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.engine.chunk import Row
    from riot_bus.record.naming import Naming
    from riot_bus.record.options import CaptureOptions
    from riot_bus.types.registry import TypeRegistry

__all__ = ["FileResult", "RotatingSink"]

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


class _OpenFile:
    """A file that is being written."""

    def __init__(self, path: Path, writer: LogWriter) -> None:
        self.path, self.writer, self.book = path, writer, LossCounts()
        self.result: FileResult | None = None
        self.began = time.monotonic()
        self.noted = 0
        self.noted_at = 0.0


class RotatingSink:
    """Sink that writes to files; thread-safe if `lock` is held where this is required.

    Args:
        options: Limits of files and chunks.
        registry: Names and types of topics.
        naming: Names for the files.
        metadata: Function that returns the metadata of each file.
        details: Function that returns more metadata of a key's channel.
        profile: MCAP profile.
        warn: Function that receives each warning as one line.
        began: Function called, without the lock, when another file has begun.

    Attributes:
        lock: Lock that a caller holds from asking for tracks to appending.
        generation: Number that grows with each file, and when a type becomes known; earlier tracks are then invalid.
    """

    def __init__(
        self,
        options: CaptureOptions,
        *,
        registry: TypeRegistry,
        naming: Naming,
        metadata: Callable[[], Mapping[str, str]],
        details: Callable[[str], Mapping[str, str]],
        profile: str,
        warn: Callable[[str], None],
        began: Callable[[], None],
    ) -> None:
        self.lock = threading.RLock()
        self.generation = 0
        self._options, self._registry, self._naming = options, registry, naming
        self._metadata, self._details, self._profile = metadata, details, profile
        self._warn, self._began = warn, began
        self._bag: dict[str, BagFile] = {}
        self._reels: list[_OpenFile] = []
        self._closing: list[threading.Thread] = []
        self._problem = ""
        self._said = self._tried = -_REPEAT_S
        self._slow = self._alarmed = self._closed = False
        self._reel = self._open(naming.next())
        self._reels.append(self._reel)
        self._write_bag()

    # -- for who appends, with the lock -------------------------------------------------------------------------------

    @property
    def writer(self) -> LogWriter:
        """Writer of the present file."""
        return self._reel.writer

    @property
    def book(self) -> LossCounts:
        """Counts of the present file."""
        return self._reel.book

    def append(self, rows: Sequence[Row], *, patient: bool) -> None:
        """Write messages; lost ones are counted."""
        reel = self._reel
        try:
            reel.writer.append(rows, patient=patient)
        except LostMessagesError as error:
            self._failed(reel, error)

    # -- for others ---------------------------------------------------------------------------------------------------

    @property
    def path(self) -> Path:
        """Path of the present file."""
        return self._reel.path

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write a metadata record."""
        reel = self._reel
        self._guard(reel, lambda: reel.writer.note(name, mapping))

    def renew(self, key: str) -> None:
        """Record further messages of a key with its type, which has become known."""
        with self.lock:
            self.writer.renew(key)
            self.generation += 1

    def tick(self) -> None:
        """End chunks by age, begin other files, report problems; call this several times a second."""
        reel = self._reel
        self._guard(reel, reel.writer.tick)
        self._note_account(reel)
        self._look()
        options = self._options
        too_large = options.split_bytes and reel.writer.size >= options.split_bytes
        too_old = options.split_seconds and time.monotonic() - reel.began >= options.split_seconds
        if too_large or too_old:
            try:
                self.split()
            except ConfigError as error:
                self._alarm(f"no other file can be begun: {error}")

    def split(self, text: str | None = None) -> tuple[Path, Path]:
        """Continue in another file, and return the former and the new path; each message is in one of the two.

        Args:
            text: Path as it was requested; None for the next name in turn.

        Raises:
            ConfigError: It is refused, or cannot be written.
        """
        path = self._naming.next(text)
        try:
            reel = self._open(path)
        except ConfigError:
            with suppress(OSError):
                path.unlink()
            raise
        with self.lock:
            former, self._reel = self._reel, reel
            self._reels.append(reel)
            self.generation += 1
            self._write_bag()
        thread = threading.Thread(target=self._finish, args=(former,), name="riot-finish", daemon=True)
        self._closing.append(thread)
        thread.start()
        self._began()
        return former.path, path

    def close(self) -> None:
        """Finish all files; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._finish(self._reel)
        for thread in self._closing:
            thread.join()

    @property
    def problem(self) -> str:
        """Why nothing can be written at present; empty as long as all is well."""
        return self._reel.writer.problem

    def account(self) -> Account:
        """Return the counts of all files."""
        return summed([each.account for each in self.files()])

    def files(self) -> list[FileResult]:
        """Return the files, in the order of writing."""
        with self.lock:
            return [
                each.result or FileResult(str(each.path), each.writer.size, each.book.account()) for each in self._reels
            ]

    def status(self) -> dict[str, Any]:
        """Return the state of the present file as JSON values."""
        reel = self._reel
        return {
            "file": str(reel.path),
            "bytes": reel.writer.size,
            "waiting_bytes": reel.writer.waiting,
            "problem": self.problem,
        }

    # -- files --------------------------------------------------------------------------------------------------------

    def _open(self, path: Path) -> _OpenFile:
        options = self._options
        writer = LogWriter(
            path,
            registry=self._registry,
            metadata=self._metadata(),
            profile=self._profile,
            compression=options.compression,
            chunk_bytes=options.chunk_bytes,
            chunk_seconds=options.chunk_seconds,
            channel_metadata=self._details,
            threaded=True,
            durable=options.durable,
            queue_bytes=options.queue_bytes,
            epilogue=bag_epilogue if self._profile == "ros2" else None,
        )
        return _OpenFile(path, writer)

    def _finish(self, reel: _OpenFile) -> None:
        writer = reel.writer
        self._guard(reel, writer.flush)
        file = bag_file(reel.path.name, writer)
        self._guard(reel, lambda: writer.note(LOST, reel.book.account().record()))
        self._guard(reel, writer.close)
        try:
            size = os.stat(reel.path).st_size
        except OSError:
            size = 0
        with self.lock:
            reel.result = FileResult(str(reel.path), size, reel.book.account())
            self._bag[reel.path.name] = file
            self._forget_oldest()
            self._write_bag()

    def _forget_oldest(self) -> None:
        most = self._options.max_files
        kept = [each for each in self._reels if os.path.lexists(each.path)]
        for each in kept[: max(0, len(kept) - most)] if most else ():
            if each.result is None:
                return  # it is still being finished, and then looked at again
            try:
                os.unlink(each.path)
                each.result = replace(each.result, deleted=True)
            except OSError as error:
                self._warn(f"{each.path} cannot be deleted: {error.strerror}")

    def _write_bag(self) -> None:
        if not self._naming.bag:
            return
        names = [each.path.name for each in self._reels if os.path.lexists(each.path)]
        try:
            write_metadata(self._naming.folder, [self._bag.get(name, BagFile(name)) for name in names])
        except OSError as error:
            self._warn(f"metadata.yaml cannot be written: {error.strerror}")

    def _note_account(self, reel: _OpenFile) -> None:
        """Write losses to the file as they happen, so that they survive a crash."""
        now = time.monotonic()
        if now - reel.noted_at < _NOTE_S:
            return
        with self.lock:
            account = reel.book.account()
        if account.total() != reel.noted and not reel.writer.problem:
            reel.noted, reel.noted_at = account.total(), now
            self._guard(reel, lambda: reel.writer.note(LOST, account.record()))

    # -- trouble ------------------------------------------------------------------------------------------------------

    def _guard(self, reel: _OpenFile, action: Callable[[], None]) -> None:
        try:
            action()
        except LostMessagesError as error:
            with self.lock:
                self._failed(reel, error)

    def _failed(self, reel: _OpenFile, error: LostMessagesError) -> None:
        for reason, lost in error.reasons.items():
            for (key, _), number in lost.items():
                reel.book.lose(reason, self._registry.topic(key), number, written=True)
        if reel is not self._reel or self._problem:
            return
        self._problem = error.message
        self._alarm(f"{error.message}: {reel.path}: messages are being lost")
        if error.errno == errno.EFBIG:
            self._tried = -_AGAIN_S  # files may not be larger here: another one will do

    def _look(self) -> None:
        """Report whether the problem persists, and try another file where that may help."""
        reel, now = self._reel, time.monotonic()
        slow = reel.writer.waiting > _SLOW * self._options.queue_bytes
        if slow and not self._slow:
            self._alarm(f"the disk is slow: {reel.writer.waiting >> 20} MiB wait to be written")
        self._slow = slow
        problem = reel.writer.problem
        if not problem:
            if self._problem and self._alarmed:
                self._warn(f"the log is being written again: {reel.path}")
            self._problem, self._alarmed = "", False
            return
        self._problem = problem
        self._alarm(f"{problem}: {reel.path}: {self.account().total()} messages are lost so far")
        if now - self._tried >= _AGAIN_S and (reel.writer.gone or reel.writer.errno not in _NO_USE):
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
