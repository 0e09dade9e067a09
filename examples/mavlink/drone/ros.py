"""Two messages of ROS 2, their keys as rmw_zenoh makes them, and a connection to a Zenoh router."""

from __future__ import annotations

import struct
from os import urandom
from time import time_ns

import zenoh

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Self

FIX_HASH = "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"
FLOAT_HASH = "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"
FIX = f"0/drone/fix/sensor_msgs::msg::dds_::NavSatFix_/{FIX_HASH}"
CLEARANCE = f"0/drone/clearance/std_msgs::msg::dds_::Float64_/{FLOAT_HASH}"

HEAD = b"\x00\x01\x00\x00"
FRAME = b"gps\x00"
FIX_LAYOUT = struct.Struct("<iII4sbxH4x3d9dB")
FLOAT_LAYOUT = struct.Struct("<d")
ATTACHMENT = struct.Struct("<qqB16s")
GPS, COVARIANCE_UNKNOWN = 1, 0

CONFIGURATION = """{
    mode: "client",
    connect: { endpoints: ["%s"], timeout_ms: 5000 },
    scouting: { multicast: { enabled: false }, gossip: { enabled: false } },
}"""


def fix(seconds: float, latitude: float, longitude: float, altitude: float) -> bytes:
    """Give a sensor_msgs/NavSatFix in CDR."""
    whole = int(seconds)
    stamp = whole, int((seconds - whole) * 1e9)
    place = latitude, longitude, altitude
    return HEAD + FIX_LAYOUT.pack(*stamp, len(FRAME), FRAME, 0, GPS, *place, *[0.0] * 9, COVARIANCE_UNKNOWN)


def read_fix(data: bytes) -> tuple[float, float, float]:
    """Return latitude, longitude and altitude of a fix; raises ValueError if it is none of ours."""
    if len(data) != len(HEAD) + FIX_LAYOUT.size or data[:4] != HEAD:
        raise ValueError("no fix")
    _, _, _, _, _, _, latitude, longitude, altitude, *_ = FIX_LAYOUT.unpack_from(data, len(HEAD))
    return latitude, longitude, altitude


def number(value: float) -> bytes:
    """Give a std_msgs/Float64 in CDR."""
    return HEAD + FLOAT_LAYOUT.pack(value)


class Session:
    """A client of a Zenoh router; a context manager."""

    def __init__(self, endpoint: str) -> None:
        escaped = endpoint.replace("\\", "\\\\").replace('"', '\\"')
        self.session = zenoh.open(zenoh.Config.from_json5(CONFIGURATION % escaped))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()  # type: ignore[no-untyped-call]

    def publisher(self, key: str) -> Publisher:
        """Return a publisher on a key."""
        return Publisher(self.session, key)


class Publisher:
    """Puts messages on one key, with the attachment of rmw_zenoh."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        self._gid, self._number = urandom(16), 0

    def put(self, payload: bytes) -> None:
        """Publish one message."""
        self._number += 1
        self._publisher.put(payload, attachment=ATTACHMENT.pack(self._number, time_ns(), 16, self._gid))
