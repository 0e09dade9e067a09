"""The attachment that rmw_zenoh puts on every message; a subscriber drops messages that lack it.

Version 2 (33 bytes) is a bare record; version 1 (77 bytes; up to Jazzy 0.2.3) names its three fields. Source:
attachment_helpers.cpp of ros2/rmw_zenoh and the serialization of zenoh-cpp.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

from riot_bus.types.capabilities import Stamp
from riot_bus.vocabulary.errors import PayloadError

_V2 = struct.Struct("<qqB16s")
_V1 = struct.Struct("<16sq17sq11sB16s")
_NAMES = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")
_GID = 16  # bytes of a gid, a hash of 128 bits (gid.py)


class Attachment(NamedTuple):
    """Sequence number of the message, its timestamp in nanoseconds since the Unix epoch, and its publisher's gid."""

    sequence: int
    source_time: int
    gid: bytes
    version: Literal[1, 2] = 2


def parse_attachment(data: bytes) -> Attachment:
    """Parse an attachment of either version.

    Raises:
        PayloadError: These are not the bytes of an attachment.
    """
    if len(data) == _V2.size:
        sequence, time, size, gid = _V2.unpack(data)
        if size == _GID:
            return Attachment(sequence, time, gid, 2)
    elif len(data) == _V1.size:
        first, sequence, second, time, third, size, gid = _V1.unpack(data)
        if (first, second, third) == _NAMES and size == _GID:
            return Attachment(sequence, time, gid, 1)
    raise PayloadError(
        f"{len(data)} bytes are not an attachment of rmw_zenoh", hint="version 2 has 33 bytes, version 1 has 77"
    )


def build_attachment(attachment: Attachment) -> bytes:
    """Return the bytes of an attachment; raises PayloadError if a number does not fit."""
    sequence, time, gid = attachment.sequence, attachment.source_time, attachment.gid
    if len(gid) != _GID:
        raise PayloadError(f"a gid has {_GID} bytes, not {len(gid)}")
    try:
        if attachment.version == 2:
            return _V2.pack(sequence, time, _GID, gid)
        return _V1.pack(_NAMES[0], sequence, _NAMES[1], time, _NAMES[2], _GID, gid)
    except struct.error as error:
        raise PayloadError(f"sequence {sequence} or time {time} is not a 64-bit integer") from error


def stamp_of(attachment: bytes) -> Stamp | None:
    """Return number, time and publisher of a message, None if these are not the bytes of an attachment.

    Recorders call it for each message, so version 2 is read here, which takes half the time of `parse_attachment`.
    """
    if len(attachment) == _V2.size:
        sequence, time, size, gid = _V2.unpack(attachment)
        return Stamp(sequence, time, gid) if size == _GID else None
    try:
        found = parse_attachment(attachment)
    except PayloadError:
        return None
    return Stamp(found.sequence, found.source_time, found.gid)
