"""pymavlink as the oracle: frames of any message with given values, and the values in a frame."""

from __future__ import annotations

import importlib
import struct
from typing import Any

from riot_bus_mavlink.definitions import MessageTable
from riot_bus_mavlink.slots import slots_of

KEY = bytes(range(32))


def dialect(name: str, version: int = 2) -> Any:
    return importlib.import_module(f"pymavlink.dialects.v{version}0.{name}")


class Oracle:
    """One sender in pymavlink."""

    def __init__(self, name: str = "all", version: int = 2, *, key: bytes | None = None) -> None:
        self.module = dialect(name, version)
        self.mav = self.module.MAVLink(None, srcSystem=17, srcComponent=34)
        self.mav.seq = 200
        if key is not None:
            self.mav.signing.secret_key = key
            self.mav.signing.link_id = 5
            self.mav.signing.sign_outgoing = True

    def knows(self, number: int) -> bool:
        return number in self.module.mavlink_map

    def pack(self, number: int, values: dict[str, Any], *, timestamp: int = 123_456_789) -> bytes:
        """Return a frame; char arrays are bytes, other arrays lists."""
        kind = self.module.mavlink_map[number]
        self.mav.signing.timestamp = timestamp
        message = kind(**{name: values[name] for name in kind.fieldnames})
        raw: bytes = message.pack(self.mav)
        return raw

    def unpack(self, raw: bytes) -> dict[str, Any]:
        self.mav.signing.stream_timestamps.clear()
        message = self.mav.decode(bytearray(raw))
        return {name: getattr(message, name) for name in message.get_fieldnames()}


def plain(message: MessageTable, fill: int) -> dict[str, Any]:
    """Return values for all fields, so that neighbouring bytes differ; a `fill` of 0 gives zeros."""
    values: dict[str, Any] = {}
    body = bytes((fill * (7 * place + 3)) & 0x7F for place in range(message.size))
    for path, slot in slots_of(message).items():
        name, bracket, _ = path.partition("[")
        value = slot.read(body)
        if isinstance(value, str):
            value = body[slot.offset : slot.end].replace(b"\0", b"x") if fill else b"\0"
        if bracket:
            values.setdefault(name, []).append(value)
        else:
            values[name] = value
    return values


def wrapped(kind: str, value: Any) -> Any:
    """Return what C makes of a number that a field cannot hold."""
    if kind == "float32":
        try:
            return struct.unpack("<f", struct.pack("<f", value))[0]
        except OverflowError:
            return float("inf") if value > 0 else float("-inf")
    if kind == "float64":
        return value
    bits = int(kind.removeprefix("u").removeprefix("int"))
    value = int(value) & ((1 << bits) - 1)
    return value if kind[0] == "u" or not value >> (bits - 1) else value - (1 << bits)
