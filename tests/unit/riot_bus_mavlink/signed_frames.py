"""Signed frames for tests."""

from __future__ import annotations

from riot_bus_mavlink.frame import SIGNED, parse_frame, seal
from riot_bus_mavlink.signing import Signer


def sign_frame(raw: bytes, signer: Signer, crc_extra: int, *, link: int, time: int) -> bytes:
    """Return an unsigned frame of MAVLink 2 with a signature.

    Args:
        raw: The frame to be signed.
        signer: Signer with the key.
        crc_extra: CRC extra byte of its message.
        link: Id of the link, 0 to 255.
        time: Timestamp, as in `Signer.sign`.
    """
    frame = parse_frame(raw)
    assert (frame.version, frame.signed) == (2, False)
    head = b"%b%c%b" % (raw[:2], SIGNED, raw[3:10])
    return signer.sign(seal(head, frame.payload, crc_extra), link, time)
