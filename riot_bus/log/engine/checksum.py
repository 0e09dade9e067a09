"""CRC-32 as MCAP uses it, several times faster than zlib's if ISA-L is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from zlib import crc32
else:
    try:
        from isal.isal_zlib import crc32
    except ImportError:  # there are no wheels for this processor
        from zlib import crc32

__all__ = ["crc32"]
