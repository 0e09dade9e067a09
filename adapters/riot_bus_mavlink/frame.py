"""Frames of MAVLink 1 and 2 as bytes, and finding them in a stream.

A frame is `FE len seq sys comp id` (MAVLink 1) or `FD len incompat compat seq sys comp id id id` (2), then `len` bytes
of payload, a checksum over all of this except the first byte and over one extra byte that stands for the message's
definition (`crc_extra`), and, in signed frames of MAVLink 2, a signature of 13 bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

from riot_bus.vocabulary.errors import PayloadError, needs_extra

ENCODING = "application/octet-stream;mavlink"
"""The encoding of frames on the bus, the same as in mavlink-server."""

V1 = 0xFE
V2 = 0xFD
HEADER_SIZE = (0, 6, 10)
"""Bytes of a header, by version of MAVLink."""
SIGNED = 0x01
"""Incompatibility flag of signed frames, the only one that is defined."""
SIGNATURE = 13
"""Bytes of a signature."""
LONGEST = HEADER_SIZE[2] + 255 + 2 + SIGNATURE
"""Bytes of the longest frame: 10 of header, 255 of payload, 2 of checksum, 13 of signature."""

KIND = slice(5, 10)
"""Where frames of MAVLink 2 have their system, component and message."""

_STARTS = (V1, V2)
_CRC_START = 0xFFFF  # initial value of CRC-16/MCRF4XX, MAVLink's checksum
_new = tuple.__new__
_EXTRA = [bytes([number]) for number in range(256)]


class Frame(NamedTuple):
    """One frame as it was received, with the values of its header.

    Attributes:
        raw: All bytes, from the first one (FE or FD) to the checksum or signature.
        version: Version of MAVLink, 1 or 2.
        sequence: Sequence number of the sender, 0 to 255.
        system: Id of the sending system.
        component: Id of the sending component.
        message_id: Id of its message.
        signed: Whether a signature follows the checksum.
    """

    raw: bytes
    version: int
    sequence: int
    system: int
    component: int
    message_id: int
    signed: bool = False

    @property
    def payload(self) -> bytes:
        """The payload as it was sent: trailing zeros may be cut off in MAVLink 2."""
        start = HEADER_SIZE[self.version]
        return self.raw[start : start + self.raw[1]]


@dataclass(slots=True)
class StreamCounts:
    """Counts of a stream; `bytes` is the sum of `frame_bytes`, `junk_bytes` and the bytes of incomplete frames.

    Attributes:
        frames: Number of frames that were passed on.
        unknown: Number of these whose message is unknown, so that their checksum could not be checked.
        bad_crc: Number of apparent frames with a wrong checksum.
        bytes: Number of all bytes.
        frame_bytes: Number of bytes in frames that were passed on.
        junk_bytes: Number of bytes that were not passed on.
    """

    frames: int = 0
    unknown: int = 0
    bad_crc: int = 0
    bytes: int = 0
    frame_bytes: int = 0
    junk_bytes: int = 0


class FrameKind(Protocol):
    """Kind of frames: one message from one component."""

    @property
    def extra(self) -> bytes:
        """The message's CRC extra byte."""


KindT = TypeVar("KindT", bound=FrameKind)


class Framer:
    """Finds frames in a stream of bytes, however it is split; after damage it continues with the next whole frame.

    A frame with a wrong checksum is junk; the search continues after its first byte, so that no frame is lost to bytes
    that only look like the beginning of one. The checksum of an unknown message cannot be checked; its frame is taken
    if the next bytes begin like a frame or, if nothing follows, if it follows a frame or is all that came at once.

    Args:
        crc_extra: Returns a message's CRC extra byte, None if the message is unknown.

    Raises:
        MissingExtraError: fastcrc is not installed.
    """

    def __init__(self, crc_extra: Callable[[int], int | None]) -> None:
        self.counts = StreamCounts()
        self._extra = crc_extra
        self._crc = load_crc()
        self._rest = b""
        self._in_step = True

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames that are complete with these bytes, in their order."""
        self.counts.bytes += len(data)
        return self._scan(self._rest + data if self._rest else data, ended=False)

    def known(self, packets: Sequence[bytes], first: int, kinds: Mapping[bytes, KindT]) -> list[KindT]:
        """Take packets as long as each is exactly one unsigned frame of MAVLink 2, of a known kind.

        Args:
            first: Index of the first packet to take.
            kinds: Known kinds, by the bytes at `KIND`.

        Returns:
            The kinds of the packets that were taken; none while the rest of a frame is awaited.
        """
        taken: list[KindT] = []
        size, crc = 0, self._crc
        for data in packets[first:] if not self._rest else ():
            kind = kinds.get(data[KIND])
            if (
                kind is None
                or data[0] != V2
                or data[1] != len(data) - 12
                or data[2]
                or crc(data[1:-2] + kind.extra, _CRC_START) != data[-2] | data[-1] << 8
            ):
                break
            taken.append(kind)
            size += len(data)
        if taken:
            counts = self.counts
            counts.frames += len(taken)
            counts.bytes += size
            counts.frame_bytes += size
            self._in_step = True
        return taken

    def flush(self) -> list[Frame]:
        """Return the whole frames among the pending bytes at the end of the stream; the rest is junk."""
        return self._scan(self._rest, ended=True) if self._rest else []

    def _scan(self, data: bytes, *, ended: bool) -> list[Frame]:
        counts = self.counts
        found: list[Frame] = []
        at, size = 0, len(data)
        fresh = not self._rest
        while at < size:
            first = data[at]
            if first != V2 and first != V1:
                following = _next_start(data, at)
                counts.junk_bytes += following - at
                self._in_step = False
                at = following
                continue
            length = frame_length(data, at)
            if length < 0 or at + length > size:
                if length < 0 or ended:
                    at += self._skip()
                    continue
                break
            frame = self._take(data, at, length, alone=fresh and length == size)
            if frame is None:
                at += self._skip()
                continue
            found.append(frame)
            counts.frames += 1
            counts.frame_bytes += length
            at += length
        self._rest = data[at:]
        return found

    def _skip(self) -> int:
        self.counts.junk_bytes += 1
        self._in_step = False
        return 1

    def _take(self, data: bytes, at: int, length: int, *, alone: bool) -> Frame | None:
        """Return the frame at a place, None if its checksum is wrong, or if it is not to be trusted."""
        frame = _parse(data, at, length)
        extra = self._extra(frame.message_id)
        if extra is None:
            end = at + length
            fits = data[end] in _STARTS if end < len(data) else self._in_step or alone
            if not fits:
                return None
            self.counts.unknown += 1
            return frame
        end = length - SIGNATURE if frame.signed else length
        raw = frame.raw
        if self._crc(raw[1 : end - 2] + _EXTRA[extra], _CRC_START) != raw[end - 2] | raw[end - 1] << 8:
            self.counts.bad_crc += 1
            return None
        self._in_step = True
        return frame


def load_crc() -> Callable[[bytes, int], int]:
    """Return MAVLink's checksum, CRC-16/MCRF4XX: a function that continues it (initially 0xFFFF) over more bytes.

    Raises:
        MissingExtraError: fastcrc is not installed.
    """
    with needs_extra("fastcrc", "mavlink"):
        from fastcrc.crc16 import mcrf4xx
    crc: Callable[[bytes, int], int] = mcrf4xx
    return crc


def parse_frame(data: bytes) -> Frame:
    """Return the one frame that these bytes are; its checksum is not checked.

    Raises:
        PayloadError: The bytes are not a frame, or more than one.
    """
    size = len(data)
    if is_plain(data):
        number = data[7] | data[8] << 8 | data[9] << 16
        return _new(Frame, (data, 2, data[4], data[5], data[6], number, False))  # faster than `Frame(...)`
    if size < 8 or data[0] not in _STARTS:
        raise PayloadError("not a MAVLink frame: it begins with FE or FD and has at least 8 bytes")
    length = frame_length(data, 0)
    if length != len(data):
        why = "has flags that are not defined" if length < 0 else f"should have {length} bytes by its header"
        raise PayloadError(f"not a MAVLink frame: it has {len(data)} bytes and {why}")
    return _parse(data, 0, length)


def is_plain(data: bytes) -> bool:
    """Return whether bytes have the header and the length of one unsigned frame of MAVLink 2, as most have."""
    size = len(data)
    return size > 11 and data[0] == V2 and data[1] == size - 12 and not data[2]


def checksum_fits(frame: Frame, crc_extra: int) -> bool:
    """Return whether the checksum of a frame is right."""
    raw = frame.raw
    end = len(raw) - (SIGNATURE if frame.signed else 0)
    return _checksum(raw[1 : end - 2], crc_extra) == raw[end - 2] | raw[end - 1] << 8


def seal(head: bytes, payload: bytes, crc_extra: int) -> bytes:
    """Return a header and payload with their checksum; the header's length is taken as it is."""
    body = head + payload
    return body + _checksum(body[1:], crc_extra).to_bytes(2, "little")


def pack_frame(
    message_id: int, payload: bytes, crc_extra: int, *, version: int, sequence: int, system: int, component: int
) -> bytes:
    """Return an unsigned frame; in MAVLink 2, trailing zeros of the payload are cut off.

    Args:
        message_id: Id of the message, at most 255 in MAVLink 1.
        payload: At most 255 bytes, in MAVLink 1 without extension fields.
        crc_extra: CRC extra byte of the message.
        version: Version of MAVLink, 1 or 2.
        sequence: Sequence number, taken modulo 256.
        system: System id of the sender, 0 to 255.
        component: Component id of the sender, 0 to 255.

    Raises:
        ValueError: A number is out of range.
        MissingExtraError: fastcrc is not installed.
    """
    if version == 1:
        return seal(bytes([V1, len(payload), sequence & 255, system, component, message_id]), payload, crc_extra)
    payload = trimmed(payload)
    head = bytes([V2, len(payload), 0, 0, sequence & 255, system, component])
    try:
        return seal(head + message_id.to_bytes(3, "little"), payload, crc_extra)
    except OverflowError as error:
        raise ValueError(f"{message_id} is not the id of a message") from error


def trimmed(payload: bytes) -> bytes:
    """Return a payload as MAVLink 2 sends it: without trailing zeros, but not without its first byte."""
    return payload.rstrip(b"\0") or payload[:1]


def _checksum(data: bytes, crc_extra: int) -> int:
    return load_crc()(data + _EXTRA[crc_extra], _CRC_START)


def _next_start(data: bytes, at: int) -> int:
    """Return the index of the next byte that may begin a frame, or the end."""
    old, new = data.find(V1, at), data.find(V2, at)
    size = len(data)
    return min(size if old < 0 else old, size if new < 0 else new)


def frame_length(data: bytes, at: int) -> int:
    """Return the length of the frame at a place: at least 8 if its header is incomplete, -1 if it is not a frame."""
    if data[at] == V1:
        return 8 + data[at + 1] if at + 1 < len(data) else 8
    if at + 2 >= len(data):
        return 12
    flags = data[at + 2]
    if flags & ~SIGNED:
        return -1
    return 12 + data[at + 1] + (SIGNATURE if flags else 0)


def _parse(data: bytes, at: int, length: int) -> Frame:
    raw = data[at : at + length]
    if raw[0] == V1:
        return Frame(raw, 1, raw[2], raw[3], raw[4], raw[5])
    return Frame(raw, 2, raw[4], raw[5], raw[6], raw[7] | raw[8] << 8 | raw[9] << 16, raw[2] == SIGNED)
