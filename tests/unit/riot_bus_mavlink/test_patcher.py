"""What sets one field in many frames does the same as setting it in each."""

from __future__ import annotations

import random

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.trial import Scalar
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.message_type import MavlinkType

DIALECT = load_dialect("common")


@pytest.mark.parametrize(
    "name", ["ATTITUDE", "HEARTBEAT", "COMMAND_LONG", "STATUSTEXT", "GPS_RAW_INT", "BATTERY_STATUS"]
)
@pytest.mark.parametrize("version", [1, 2])
def test_it_is_the_same_as_to_patch(name: str, version: int) -> None:
    message = DIALECT.message(name)
    assert message is not None
    kind = MavlinkType(message, DIALECT.enums)
    draw = random.Random(name)
    size = message.base_size if version == 1 else message.size
    for _ in range(20):
        body = bytes(draw.choice((0, draw.randrange(256))) for _ in range(size))
        frame = pack_frame(message.id, body, message.crc_extra, version=version, sequence=7, system=1, component=2)
        for leaf in kind.leaves(frame):
            values: tuple[Scalar, ...] = ("", "text") if isinstance(leaf.value, str) else (0, 1, 255)
            for value in values:
                patch = kind.patcher(leaf.path, value)
                if patch is not None:
                    assert patch(frame) == kind.patch(frame, {leaf.path: value})
                    with pytest.raises(PayloadError):
                        patch(frame[:-1] + bytes([frame[-1] ^ 1]))
