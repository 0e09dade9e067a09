"""Signatures of MAVLink 2: a link id, an increasing timestamp, and the first bytes of a hash with a secret key.

Anyone who knows the key can sign; receivers accept what is newer than the last message of the same sender and link.
"""

from __future__ import annotations

import hashlib
import hmac
from pathlib import Path

from riot_bus.given_files import given_bytes
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_mavlink.frame import SIGNATURE, SIGNED, V2, Frame

KEY_BYTES = 32  # SHA-256 of a passphrase (MAVLink 2, message signing)
_HASH_BYTES = 6  # of the signature, 48 bits of SHA-256
_MOST_STREAMS = 1 << 14  # of 2**24 that ids can tell apart: bounds memory at about 2 MB


class Signer:
    """Signs frames, and checks signatures.

    Raises:
        ConfigError: The key does not have 32 bytes.
    """

    def __init__(self, key: bytes) -> None:
        if len(key) != KEY_BYTES:
            raise ConfigError(f"a key of MAVLink has {KEY_BYTES} bytes, this one {len(key)}")
        self._key = key

    def __repr__(self) -> str:
        return "Signer(...)"

    def sign(self, body: bytes, link: int, time: int) -> bytes:
        """Return a frame with its signature.

        Args:
            body: The frame from FD to the checksum, with the flag of signed frames in its header.
            link: Id of the link, 0 to 255.
            time: Timestamp, 0 to 2**48 - 1, in units of 10 us since 2015-01-01 UTC.
        """
        head = b"%b%c%b" % (body, link, time.to_bytes(6, "little"))
        return head + self._hash(head)

    def made(self, raw: bytes) -> bool:
        """Return whether the signature at the end of a signed frame is the one that this key makes."""
        return hmac.compare_digest(raw[-_HASH_BYTES:], self._hash(raw[:-_HASH_BYTES]))

    def _hash(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:_HASH_BYTES]


class Renewer:
    """Keeps signature timestamps increasing when frames were delayed, repeated, added, or played from a log.

    Each sender (system and component) has its own timestamp on each link. When there are 16384 of them and another one
    comes, the one heard first is forgotten.
    """

    def __init__(self, signer: Signer) -> None:
        self._signer = signer
        self._last: dict[bytes, int] = {}

    def renew(self, raw: bytes, *, now: int = 0) -> bytes:
        """Return a frame as it may be sent now: unchanged if its timestamp increased, else re-signed with a later one.

        Args:
            raw: One frame. A frame that is not signed, or not with this key, stays unchanged: it never gets a valid
                signature here.
            now: Smallest timestamp that it should have, as in `Signer.sign`.

        Raises:
            PayloadError: The bytes are not a frame, or there is no later timestamp.
        """
        if len(raw) < 12 + SIGNATURE or raw[0] != V2 or raw[2] != SIGNED or not self._signer.made(raw):
            return raw
        stream = raw[-13:-12] + raw[5:7]
        last = self._last.get(stream, -1)
        time = int.from_bytes(raw[-12:-6], "little")
        if time <= last or time < now:
            time = max(now, last + 1)
            if time >> 48:  # a signature has 48 bits for it
                raise PayloadError("there is no later time for a signature")
            raw = self._signer.sign(raw[:-SIGNATURE], raw[-13], time)
        if last < 0 and len(self._last) >= _MOST_STREAMS:
            del self._last[next(iter(self._last))]
        self._last[stream] = time
        return raw


def time_of(frame: Frame) -> int:
    """Return the timestamp in the signature of a signed frame."""
    return int.from_bytes(frame.raw[-12:-6], "little")


def link_of(frame: Frame) -> int:
    """Return the link id in the signature of a signed frame."""
    return frame.raw[-13]


def key_of_phrase(phrase: str) -> bytes:
    """Return the key that ground stations make of a passphrase: its SHA-256."""
    return hashlib.sha256(phrase.encode()).digest()


def read_key(file: Path) -> bytes:
    """Read a key: 32 bytes, 64 hexadecimal digits, or a passphrase on one line.

    Raises:
        ConfigError: The file cannot be read, or is empty.
    """
    try:
        data = given_bytes(Path(file))
    except OSError as error:
        raise ConfigError(f"the key cannot be read: {error.strerror}", where=str(file)) from error
    if len(data) == KEY_BYTES and not (
        data.endswith(b"\n") and data[:-1].isascii() and data[:-1].decode().isprintable()
    ):
        return data  # otherwise, it is a 31-character passphrase with a line end
    try:
        text = data.decode().strip()
    except UnicodeDecodeError:
        text = ""
    if not text or "\n" in text or len(text) > 1024:
        hint = "32 bytes, 64 hexadecimal digits, or a passphrase on one line"
        raise ConfigError("this is not a key of MAVLink", where=str(file), hint=hint)
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    return key if len(key) == KEY_BYTES else key_of_phrase(text)
