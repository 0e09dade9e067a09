"""Telemetry logs (.tlog) of ground stations: each frame follows its time, 8 bytes of microseconds since 1970.

Ground stations store the number of the link in the last two bits of the time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.frame import ENCODING, V1, V2, Frame, StreamCounts, checksum_fits, frame_length, parse_frame

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_mavlink.dialect import Dialect
    from riot_bus_mavlink.keys import KeyTemplate

LINK = "tlog"
"""The name of the link over which messages of a telemetry log come."""
_TIME = 8
_LEAST, _MOST = 10**15, 5 * 10**15
"""Times between 2001 and 2128, in microseconds."""


class TlogRecord(NamedTuple):
    """A frame and when it was received, in nanoseconds since the Unix epoch."""

    time: int
    frame: Frame


class TlogReader:
    """Splits a telemetry log into records, in pieces of any size; after damage it continues with the next valid record.

    Attributes:
        counts: Counts of the log, in which a frame includes its time; one with a wrong checksum only counts as such if
            the next record follows it.
    """

    def __init__(self, crc_extra: Callable[[int], int | None]) -> None:
        self.counts = StreamCounts()
        self._extra = crc_extra
        self._rest = b""
        self._in_step = True

    def feed(self, data: bytes) -> list[TlogRecord]:
        """Return the records that are complete with these bytes."""
        self.counts.bytes += len(data)
        return self._scan(self._rest + data, ended=False)

    def flush(self) -> list[TlogRecord]:
        """Return the remaining records at the end of the file; all other bytes are junk."""
        return self._scan(self._rest, ended=True)

    def _scan(self, data: bytes, *, ended: bool) -> list[TlogRecord]:
        counts = self.counts
        found: list[TlogRecord] = []
        at, size = 0, len(data)
        while at < size:
            begin = at + _TIME
            wanted = 8 if begin >= size else frame_length(data, begin) if data[begin] in (V1, V2) else -1
            if wanted >= 0 and begin + wanted + _TIME >= size and not ended:
                break  # the next bytes show whether this is a damaged record
            record = None
            end = begin + wanted
            if wanted >= 0 and end <= size:
                record = self._record(data, at, end)
            if record is not None:
                found.append(record)
                counts.frames += 1
                counts.frame_bytes += end - at
                at = end
            elif self._in_step and wanted >= 0 and _begins(data, end):
                counts.bad_crc += 1
                counts.junk_bytes += end - at
                at = end
            else:
                counts.junk_bytes += 1
                self._in_step = False
                at += 1
        self._rest = data[at:]
        return found

    def _record(self, data: bytes, at: int, end: int) -> TlogRecord | None:
        frame = parse_frame(data[at + _TIME : end])
        extra = self._extra(frame.message_id)
        time = int.from_bytes(data[at : at + _TIME])
        if not self._in_step and (extra is None or not _LEAST <= time < _MOST):
            return None
        if time >= _MOST or (extra is not None and not checksum_fits(frame, extra)):
            return None
        if extra is None and end < len(data) and not _begins(data, end):
            return None
        self.counts.unknown += extra is None
        self._in_step = True
        return TlogRecord(time * 1_000, frame)


class TlogUnpacker:
    """A telemetry log as messages of the bus: `riot_bus.types.capabilities.Unpacker`."""

    def __init__(self, dialect: Dialect, template: KeyTemplate) -> None:
        self._dialect, self._template = dialect, template
        self._reader = TlogReader(dialect.crc_extra)
        self._number = 0

    def feed(self, data: bytes) -> Sequence[Message]:
        """Return the messages that are complete with these bytes."""
        return [self._message(record) for record in self._reader.feed(data)]

    def end(self) -> Sequence[Message]:
        """Return the remaining messages at the end of the file."""
        return [self._message(record) for record in self._reader.flush()]

    def loss(self) -> str:
        """Return what could not be read, empty if nothing."""
        counts = self._reader.counts
        if not counts.junk_bytes:
            return ""
        return f"{counts.junk_bytes} bytes are in no valid record; {counts.bad_crc} records there have a wrong checksum"

    def _message(self, record: TlogRecord) -> Message:
        frame = record.frame
        name = self._dialect.name_of(frame.message_id)
        key = self._template.key(LINK, frame.system, frame.component, name)
        self._number += 1
        return Message(record.time, key, frame.raw, encoding=ENCODING, sequence=self._number)


def _begins(data: bytes, at: int) -> bool:
    return at + _TIME < len(data) and data[at + _TIME] in (V1, V2)


def tlog_record(time: int, raw: bytes) -> bytes:
    """Return the bytes of a record.

    Args:
        time: Nanoseconds since the Unix epoch.
    """
    return (max(0, time) // 1_000).to_bytes(_TIME) + raw
