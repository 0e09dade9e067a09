"""Little-endian plain CDR, as ROS 2 puts it on the wire."""

from __future__ import annotations

from struct import Struct, error, pack

HEADER = b"\x00\x01\x00\x00"
UINT32 = Struct("<I")


class DecodeError(ValueError):
    """A payload is not the message it should be."""


class Writer:
    """Appends values to one message; alignment counts from behind the encapsulation header."""

    __slots__ = ("_buffer",)

    def __init__(self) -> None:
        self._buffer = bytearray(HEADER)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes."""
        self._buffer += bytes(-(len(self._buffer) - 4) % size)

    def put(self, layout: Struct, size: int, *values: float) -> None:
        """Append fixed-size values whose largest member is `size` bytes wide."""
        self.align(size)
        self._buffer += layout.pack(*values)

    def string(self, text: str) -> None:
        """Append a string."""
        raw = text.encode() + b"\x00"
        self.put(UINT32, 4, len(raw))
        self._buffer += raw

    def octets(self, data: bytes) -> None:
        """Append a sequence of one-byte elements."""
        self.put(UINT32, 4, len(data))
        self._buffer += data

    def sequence(self, code: str, values: list[float] | list[int]) -> None:
        """Append a sequence of four-byte elements of one struct `code`."""
        self.put(UINT32, 4, len(values))
        self._buffer += pack(f"<{len(values)}{code}", *values)

    def finish(self) -> bytes:
        """Give the whole message."""
        return bytes(self._buffer)


class Reader:
    """Takes values out of one message; raises `DecodeError` where the message ends too early."""

    __slots__ = ("_data", "_offset")

    def __init__(self, data: bytes) -> None:
        if data[:2] != HEADER[:2]:
            raise DecodeError(f"not little-endian CDR (it starts with {data[:4].hex() or 'nothing'})")
        self._data = data
        self._offset = 4

    def take(self, layout: Struct, size: int) -> tuple[float, ...]:
        """Take fixed-size values whose largest member is `size` bytes wide."""
        start = self._offset + -(self._offset - 4) % size
        try:
            values = layout.unpack_from(self._data, start)
        except error:
            raise DecodeError(f"ends after {len(self._data)} bytes, {start + layout.size} needed") from None
        self._offset = start + layout.size
        return values

    def skip_string(self) -> None:
        """Pass over a string."""
        self._advance(self.count())

    def octets(self) -> bytes:
        """Take a sequence of one-byte elements."""
        size = self.count()
        start = self._offset
        self._advance(size)
        return self._data[start : self._offset]

    def count(self) -> int:
        """Take the length of a string or a sequence."""
        start = self._offset + -self._offset % 4
        if start + 4 > len(self._data):
            raise DecodeError(f"ends after {len(self._data)} bytes, within a length")
        self._offset = start + 4
        return int.from_bytes(self._data[start : self._offset], "little")

    def _advance(self, size: int) -> None:
        if size > len(self._data) - self._offset:
            raise DecodeError(f"{size} bytes announced, {len(self._data) - self._offset} there")
        self._offset += size
