"""Logs of ground stations (`.tlog`) as links: read at the pace of their timestamps, or written."""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path
from typing import BinaryIO, Literal

from riot_bus.given_files import given_file
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_bridges.links.link import Host, Link, reason
from riot_bus_bridges.mavlink.url import LinkSpec
from riot_bus_mavlink.tlog import TlogReader, TlogRecord, tlog_record


class _LogLink(Link):
    """Link to a file, which is its only end."""

    idle = "ended"

    def __init__(self, spec: LinkSpec, host: Host, mode: Literal["rb", "ab"]) -> None:
        super().__init__(spec, host)
        try:
            path = given_file(Path(spec.path)) if mode == "rb" else Path(spec.path)
            self._file: BinaryIO | None = path.open(mode)
        except OSError as error:
            what = "read" if mode == "rb" else "written"
            raise EnvironmentFaultError(f"cannot be {what}: {reason(error)}", where=spec.path) from error

    @property
    def state(self) -> str:
        return self.idle if self._file is None else self.busy

    def _close_file(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


class TelemetryLogSource(_LogLink):
    """Sends the frames of a log as if they came now, paced by the log's timestamps."""

    busy = "reading"

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host, "rb")
        self._records: deque[TlogRecord] = deque()
        self._reader = TlogReader(host.crc_extra)
        self._begun: tuple[float, int] | None = None
        self._end = self.join(spec.path, lambda data: False)
        self._timer = host.loop.later(0.0, self._go_on)

    @property
    def state(self) -> str:
        """Return `reading` until the last record is taken."""
        return self.busy if self._records else super().state

    def close(self) -> None:
        """Close the link; its end leaves."""
        self._timer.cancel()
        self._close_file()
        self._records.clear()
        super().close()

    def _go_on(self) -> None:
        for _ in range(256):  # then other links get their turn
            if not self._records and not self._read():
                return
            wait = self._wait(self._records[0].time)
            if wait > 0:
                self._timer = self._host.loop.later(wait, self._go_on)
                return
            self._host.receive(self._end, [self._records.popleft().frame.raw])
        self._timer = self._host.loop.later(0.0, self._go_on)

    def _wait(self, time_ns: int) -> float:
        """Return the seconds until a record with this timestamp is due."""
        if self._begun is None:
            self._begun = time.monotonic(), time_ns
        if not self.spec.rate:
            return 0.0
        start, first = self._begun
        return start + (time_ns - first) / 1e9 / self.spec.rate - time.monotonic()

    def _read(self) -> bool:
        """Read until there is a record; return whether there is one."""
        while not self._records and self._file is not None:
            try:
                data = self._file.read(1 << 16)
            except OSError as error:
                self._host.warn(self.spec, reason(error))
                data = b""
            self._records += self._reader.feed(data) if data else self._reader.flush()
            if not data:
                self._close_file()
                junk = self._reader.counts.junk_bytes
                if junk:
                    self._host.warn(self.spec, f"{junk} bytes are not in any record")
        return bool(self._records)


class TelemetryLogSink(_LogLink):
    """Appends all frames that are sent to it, each with its time."""

    busy = "writing"

    def __init__(self, spec: LinkSpec, host: Host) -> None:
        super().__init__(spec, host, "ab")
        self._lock = threading.Lock()
        self.join(spec.path, self._write)
        self._timer = host.loop.later(1.0, self._flush)

    def close(self) -> None:
        """Close the link; its end leaves."""
        self._timer.cancel()
        with self._lock:
            self._close_file()
        super().close()

    def _write(self, data: bytes) -> bool:
        with self._lock:
            if self._file is None:
                return False
            try:
                self._file.write(tlog_record(time.time_ns(), data))
            except OSError as error:
                self._host.warn(self.spec, reason(error))
                return False
            return True

    def _flush(self) -> None:
        with self._lock:
            if self._file is not None:
                try:
                    self._file.flush()
                except OSError as error:
                    self._host.warn(self.spec, reason(error))
        self._timer = self._host.loop.later(1.0, self._flush)
