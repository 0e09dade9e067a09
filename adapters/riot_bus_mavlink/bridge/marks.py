"""Attachments of frames on the bus, which tell whether a frame came over a link, and of which bridge."""

from __future__ import annotations

import secrets

__all__ = ["INSERTED", "is_mark", "new_mark"]

_MAGIC = b"mavlink-link-1 "
INSERTED = _MAGIC + b"inserted"
"""Attachment of frames that a bridge put on the bus for another sender; they are numbered already."""
_ID_BYTES = 8  # a chance of 3e-8 that two of a million bridges have the same


def new_mark() -> bytes:
    """Return a new attachment for the frames of one bridge."""
    return _MAGIC + secrets.token_bytes(_ID_BYTES)


def is_mark(attachment: bytes | None) -> bool:
    """Return whether a frame came over a link: of this bridge or another, or of an earlier one if played from a log."""
    return attachment is not None and attachment.startswith(_MAGIC)
