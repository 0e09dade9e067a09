"""What MAVLink costs per frame: finding frames in a stream, reading a field, changing one; pymavlink beside it.

    python benchmarks/mavlink_codec.py [--rounds N] [--json FILE]

Microseconds of processor time per frame, median of the rounds. The mix is what an autopilot sends in flight.
"""

from __future__ import annotations

import argparse
import json
import statistics
import struct
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import all as pymavlink

from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import Framer, pack_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.signing import Renewer, Signer
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame

if TYPE_CHECKING:
    from collections.abc import Callable

_FRAMES = 4_000
_FIELDS = {
    "ATTITUDE": "roll", "GLOBAL_POSITION_INT": "lat", "VFR_HUD": "alt", "SYS_STATUS": "voltage_battery",
    "HEARTBEAT": "custom_mode", "RC_CHANNELS": "chan3_raw", "STATUSTEXT": "severity", "GPS_RAW_INT": "lon",
}  # fmt: skip


def frames() -> list[tuple[MavlinkType, bytes, str]]:
    """Return types, frames, and a field of each."""
    dialect = load_dialect()
    found = []
    for number in range(_FRAMES):
        name, field = list(_FIELDS.items())[number % len(_FIELDS)]
        message = dialect.message(name)
        assert message is not None
        body = struct.pack("<I", number) + bytes(range(1, message.size - 3))
        raw = pack_frame(
            message.id, body[: message.size], message.crc_extra, version=2, sequence=number, system=1, component=1
        )
        found.append((MavlinkType(message, dialect.enums), raw, field))
    return found


def ours(work: list[tuple[MavlinkType, bytes, str]]) -> dict[str, Callable[[], Any]]:
    """Return what is measured of riot."""
    dialect = load_dialect()
    stream = b"".join(raw for _, raw, _ in work)
    signer = Signer(bytes(32))
    signed = [sign_frame(raw, signer, kind.message.crc_extra, link=1, time=9) for kind, raw, _ in work]
    signing = [MavlinkType(kind.message, {}, signer=signer) for kind, _, _ in work]
    patchers = [kind.patcher(field, 1) for kind, _, field in work]
    assert all(patchers)

    def in_pieces(size: int) -> None:
        framer = Framer(dialect.crc_extra)
        for at in range(0, len(stream), size):
            framer.feed(stream[at : at + size])
        assert framer.counts.frames == len(work)

    def datagrams() -> None:
        framer = Framer(dialect.crc_extra)
        for _, raw, _ in work:
            framer.feed(raw)
        assert framer.counts.frames == len(work)

    return {
        "framer, one frame each time": datagrams,
        "framer, 4096 bytes each time": lambda: in_pieces(4096),
        "read one field": lambda: [kind.read(raw, field) for kind, raw, field in work],
        "list all fields": lambda: [kind.leaves(raw) for kind, raw, _ in work],
        "patch one field": lambda: [kind.patch(raw, {field: 1}) for kind, raw, field in work],
        "patch one field, prepared": lambda: [
            patch(raw) for patch, (_, raw, _) in zip(patchers, work, strict=True) if patch is not None
        ],
        "patch one field, signed": lambda: [
            kind.patch(raw, {field: 1}) for kind, raw, (_, _, field) in zip(signing, signed, work, strict=True)
        ],
        "renew a signature": lambda: [Renewer(signer).renew(raw, now=10) for raw in signed],
    }


def theirs(work: list[tuple[MavlinkType, bytes, str]]) -> dict[str, Callable[[], Any]]:
    """Return what is measured of pymavlink."""
    mav = pymavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.robust_parsing = True
    buffers = [bytearray(raw) for _, raw, _ in work]

    def patch() -> None:
        for buffer, (_, _, field) in zip(buffers, work, strict=True):
            message = mav.decode(buffer)
            setattr(message, field, 1)
            message.pack(mav)

    return {
        "pymavlink: parse_char": lambda: [mav.parse_char(raw) for _, raw, _ in work],
        "pymavlink: decode": lambda: [mav.decode(buffer) for buffer in buffers],
        "pymavlink: decode, set, pack": patch,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    begun = time.process_time()
    load_dialect()
    loading = time.process_time() - begun
    work = frames()
    measured: dict[str, list[float]] = {}
    for _ in range(arguments.rounds):
        for name, act in (ours(work) | theirs(work)).items():
            begun = time.process_time()
            act()
            measured.setdefault(name, []).append((time.process_time() - begun) / len(work) * 1e6)
    medians = {name: statistics.median(values) for name, values in measured.items()}
    for name, value in medians.items():
        spread = f"{min(measured[name]):.2f} - {max(measured[name]):.2f}"
        print(f"{name:32} {value:6.2f} us  ({spread})  {1e6 / value:9,.0f} frames/s on one core")
    print(f"loading the dialect `all`: {loading:.3f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps({"microseconds": medians, "loading_seconds": loading}, indent=1))


if __name__ == "__main__":
    main()
