"""Takes apart the frames of a motor controller; those with a wrong form or checksum are passed over."""

import math
import re

import bitstruct
from crccheck.crc import CrcX25

FORM = bitstruct.compile("u8u3b1u12s8f32u4", ["sync", "mode", "armed", "volts", "temp", "rpm", "count"])
SIZE = (8 + 3 + 1 + 12 + 8 + 32 + 4 + 7) // 8


def node(publish, checked):
    last = None

    def frame(m):
        nonlocal last
        if not re.fullmatch("[0-9a-fA-F]+", m["hex"]) or len(m["hex"]) != 2 * (SIZE + 2):
            return
        data = bytes.fromhex(m["hex"])
        if CrcX25.calc(data[:-2]) != int.from_bytes(data[-2:], "little"):
            return
        found = FORM.unpack(data)
        if found["sync"] != 0xA5 or not math.isfinite(found["rpm"]):
            return
        lost = 0 if last is None else (found["count"] - last - 1) % 16
        last = found["count"]
        volts = found["volts"] / 100
        publish("motor", {"rpm": found["rpm"], "volts": volts, "temp": found["temp"], "armed": found["armed"]})
        if lost:
            publish("motor", {"lost": lost})

    return {"frame": frame}
