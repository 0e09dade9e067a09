"""What a bridge attaches to frames on the bus: that they came over a link, and of which bridge."""

from __future__ import annotations

import secrets
from enum import Enum

__all__ = ["INSERTED", "Mark", "new_mark", "origin_of"]

_MAGIC = b"mavlink-link-1 "
INSERTED = _MAGIC + b"inserted"
"""Attached to frames that a bridge has put on the bus for somebody else; they have numbers already."""
_ID_BYTES = 8


class Mark(Enum):
    """Where a frame on the bus is from."""

    OWN = "a link of this bridge"
    OTHER = "a link of another bridge, or of an earlier one if it is played from a log"
    NONE = "no link"


def new_mark() -> bytes:
    """Return the attachment of one bridge's frames."""
    return _MAGIC + secrets.token_bytes(_ID_BYTES)


def origin_of(attachment: bytes | None, own: bytes) -> Mark:
    """Return where a frame is from.

    Args:
        attachment: What came with it.
        own: The mark of this bridge.
    """
    if attachment == own:
        return Mark.OWN
    return Mark.OTHER if attachment is not None and attachment.startswith(_MAGIC) else Mark.NONE
