"""Frames for tests of the bridge."""

from __future__ import annotations

from riot_bus_mavlink.dialect import Dialect, load_dialect
from riot_bus_mavlink.frame import Frame, pack_frame, parse_frame
from riot_bus_mavlink.message_type import MavlinkType

COMMON: Dialect = load_dialect("common")


def frame_of(
    name: str = "HEARTBEAT",
    *,
    source: tuple[int, int] = (1, 1),
    target: tuple[int, int] | None = None,
    sequence: int = 0,
    version: int = 2,
    **fields: int | float | str,
) -> Frame:
    """Return a frame of a message; fields that are not given are zero."""
    message = COMMON.message(name)
    assert message is not None
    size = message.size if version == 2 else message.base_size
    raw = pack_frame(
        message.id,
        bytes(size),
        message.crc_extra,
        version=version,
        sequence=sequence,
        system=source[0],
        component=source[1],
    )
    if target is not None:
        fields["target_system"] = target[0]
        if "target_component" in message.places:
            fields["target_component"] = target[1]
    return parse_frame(MavlinkType(message, COMMON.enums).patch(raw, fields))


def unknown_frame(*, source: tuple[int, int] = (1, 1), sequence: int = 0, message_id: int = 15_000_000) -> Frame:
    """Return a frame of a message that no dialect has."""
    return parse_frame(
        pack_frame(message_id, b"\1\2\3", 7, version=2, sequence=sequence, system=source[0], component=source[1])
    )
