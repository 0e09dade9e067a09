"""The checksum of MAVLink frames: CRC-16/MCRF4XX (X.25's polynomial, without the final inversion)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["load_crc"]


def load_crc() -> Callable[[bytes, int], int]:
    """Return a function that continues a checksum (initially 0xFFFF) over more bytes.

    Raises:
        MissingExtraError: fastcrc is not installed.
    """
    try:
        from fastcrc.crc16 import mcrf4xx
    except ImportError:
        raise MissingExtraError("fastcrc", "mavlink") from None
    crc: Callable[[bytes, int], int] = mcrf4xx
    return crc
