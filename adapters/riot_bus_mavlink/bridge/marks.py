"""Attachments of frames on the bus: whether a frame came over a link, and of which bridge."""

from __future__ import annotations

import secrets
from enum import Enum

__all__ = ["INSERTED", "Mark", "new_mark", "origin_of"]

_MAGIC = b"mavlink-link-1 "
INSERTED = _MAGIC + b"inserted"
"""Attachment of frames that a bridge put on the bus for another sender; they are numbered already."""
_ID_BYTES = 8  # a chance of 3e-8 that two of a million bridges have the same


class Mark(Enum):
    """Origin of a frame on the bus."""

    OWN = "a link of this bridge"
    OTHER = "a link of another bridge, or of an earlier one if it is played from a log"
    NONE = "no link"


def new_mark() -> bytes:
    """Return a new attachment for the frames of one bridge."""
    return _MAGIC + secrets.token_bytes(_ID_BYTES)


def origin_of(attachment: bytes | None, own: bytes) -> Mark:
    """Return the origin of a frame.

    Args:
        attachment: Attachment of the frame, None if it has none.
        own: The mark of this bridge.
    """
    if attachment == own:
        return Mark.OWN
    return Mark.OTHER if attachment is not None and attachment.startswith(_MAGIC) else Mark.NONE
