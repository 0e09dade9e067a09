"""A control: there is no fault to trigger."""

import struct


def checksum(data):
    rest = 0xFFFF
    for each in data:
        rest ^= each
        for _ in range(8):
            rest = rest >> 1 ^ (0x8408 if rest & 1 else 0)
    return rest ^ 0xFFFF


def nominal():
    for i in range(80):
        (rpm,) = struct.unpack(">I", struct.pack(">f", 1500.0 + 12.5 * (i % 30)))
        bits = 0xA5
        for value, width in ((i // 20, 3), (i > 4, 1), (2400 - i, 12), (30 + i // 8, 8), (rpm, 32), (i % 16, 4)):
            bits = bits << width | int(value)
        data = (bits << 4).to_bytes(9, "big")
        text = (data + checksum(data).to_bytes(2, "little")).hex()
        yield i * 0.05, "frame", {"hex": text, "port": f"can{i % 2}"}
