"""The file of a recording: a log of which is known at any time what would be lost if the disk failed."""

from __future__ import annotations

import os
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus.clock import ManualClock
from riot_bus.errors import ConfigError, EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.log.layout import Role
    from riot_bus.message import Message
    from riot_bus.pipeline.event import Change

__all__ = ["BrokenFileError", "RecordingFile"]

_CHUNK_BYTES = 1 << 20
_CHUNK_S = 1.0
_NEVER = 1 << 62
_AT_ONCE_S = 1e-9


class BrokenFileError(EnvironmentFaultError):
    """Nothing can be written to this file any more.

    Attributes:
        lost: Messages, by key and role, that were written and yet are not in the file.
    """

    def __init__(self, message: str, *, where: str, lost: Counter[tuple[str, Role]]) -> None:
        super().__init__(message, where=where, hint="make room, then go on in another file: riot ctl record split")
        self.lost = lost


class RecordingFile:
    """Writes a log; a `Writer` for recorders.

    The log itself does not say which messages are in the file already, so when its chunks end is decided here. After
    one error of the disk nothing more is written: what would follow half a chunk, nobody could read.

    Args:
        path: File to create; an existing one is overwritten.
        settings: For `LogWriter`.

    Raises:
        ConfigError: It cannot be written.
    """

    def __init__(self, path: Path, **settings: Any) -> None:
        from riot_bus.log.writer import LogWriter

        self._clock = ManualClock()
        self._where = str(path)
        self._broken = ""
        self._chunk: Counter[tuple[str, Role]] = Counter()
        self._whole: Counter[tuple[str, Role]] = Counter()
        self._bytes = 0
        self._began = 0.0
        try:
            self._log = LogWriter(path, chunk_bytes=_NEVER, chunk_seconds=_AT_ONCE_S, clock=self._clock, **settings)
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise ConfigError(f"cannot write the log: {error.strerror}", where=str(path)) from error
        self._linked = os.fstat(self._handle).st_nlink > 0  # not all file systems know

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Write one message.

        Raises:
            BrokenFileError: The disk failed, now or before; this message is not written either.
            ValueError: A log cannot hold this message, only others.
        """
        self._check()
        now = time.monotonic()
        if self._bytes >= _CHUNK_BYTES or (self._chunk and now - self._began >= _CHUNK_S):
            self._end_chunk()
        self._log.write(message, role=role, changes=changes)
        if self._log.lost:
            self._log.lost.clear()  # else somebody who invents keys takes the memory
            raise ValueError("a log holds neither this many keys nor such times")
        if not self._chunk:
            self._began = now
        self._chunk[message.key, role] += 1
        self._bytes += len(message.payload) + len(message.attachment or b"")

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write something else that belongs to the log."""
        self._check()
        try:
            self._log.note(name, mapping)
        except OSError as error:
            self._break(error.strerror)

    def tick(self) -> None:
        """Make readable what was written, if it is time; raises BrokenFileError once if the file is gone."""
        if self._broken:
            return
        if self._linked and not os.fstat(self._handle).st_nlink:
            self._chunk.update(self._whole)
            self._break("the file was removed")
        if self._chunk and time.monotonic() - self._began >= _CHUNK_S:
            self._end_chunk()

    def close(self) -> None:
        """Finish the file; safe to call twice. Raises BrokenFileError if that is how it breaks."""
        if self._handle < 0:
            return
        try:
            self.tick()
            if not self._broken:
                self._end_chunk()
        finally:
            os.close(self._handle)
            self._handle = -1
            self._finish()

    def _check(self) -> None:
        if self._broken:
            raise BrokenFileError(self._broken, where=self._where, lost=Counter())

    def _end_chunk(self) -> None:
        self._clock.sleep_until(self._clock.now() + 1)
        try:
            self._log.tick()
        except OSError as error:
            self._break(error.strerror)
        self._whole.update(self._chunk)
        self._chunk.clear()
        self._bytes = 0

    def _finish(self) -> None:
        try:
            self._log.close()
        except OSError as error:
            if not self._broken:  # all messages are in the file; what is missing is its summary
                self._break(error.strerror)

    def _break(self, reason: str | None) -> None:
        self._broken = f"nothing is recorded any more: {reason or 'the disk failed'}"
        lost = Counter(self._chunk)
        self._chunk.clear()
        self._whole.clear()
        raise BrokenFileError(self._broken, where=self._where, lost=lost)
