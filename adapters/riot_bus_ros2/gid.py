"""The global id of a ROS endpoint over rmw_zenoh: XXH3 (128 bits, no seed) of its liveliness token.

Only graph tools and message information show it, so speed does not matter here. Written from the specification
(github.com/Cyan4973/xxHash, doc/xxhash_spec.md), for texts of more than 16 bytes, which tokens always are.
"""

from __future__ import annotations

import struct

_SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221"
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb"
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
_P32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
_P64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)
_64 = (1 << 64) - 1
_STRIPE = 64
_STRIPES = (len(_SECRET) - _STRIPE) // 8
"""Secret, primes and length of a stripe as the specification defines them: other values give other hashes."""


def gid_of(token: str) -> bytes:
    """Return the gid of the endpoint that a liveliness token announces: low half first, little-endian."""
    return xxh3_128(token.encode()).to_bytes(16, "little")


def xxh3_128(data: bytes) -> int:
    """Return the hash of more than 16 bytes; raises ValueError for fewer."""
    if len(data) <= 16:
        raise ValueError(f"{len(data)} bytes are too few for a token")
    if len(data) <= 240:
        return _medium(data)
    return _long(data)


def _read(data: bytes, position: int) -> int:
    found: int = struct.unpack_from("<Q", data, position)[0]
    return found


def _fold(first: int, second: int) -> int:
    product = first * second
    return (product & _64) ^ (product >> 64)


def _avalanche(value: int) -> int:
    value ^= value >> 37
    value = value * 0x165667919E3779F9 & _64
    return value ^ (value >> 32)


def _mix(data: bytes, position: int, secret: int) -> int:
    return _fold(_read(data, position) ^ _read(_SECRET, secret), _read(data, position + 8) ^ _read(_SECRET, secret + 8))


def _medium(data: bytes) -> int:
    size = len(data)
    low, high = size * _P64[0] & _64, 0

    def round_(low: int, high: int, first: int, second: int, secret: int) -> tuple[int, int]:
        low = low + _mix(data, first, secret) & _64
        low ^= _read(data, second) + _read(data, second + 8) & _64
        high = high + _mix(data, second, secret + 16) & _64
        high ^= _read(data, first) + _read(data, first + 8) & _64
        return low, high

    if size <= 128:
        for step in reversed(range((size - 1) // 32 + 1)):
            low, high = round_(low, high, 16 * step, size - 16 * (step + 1), 32 * step)
    else:
        for step in range(4):
            low, high = round_(low, high, 32 * step, 32 * step + 16, 32 * step)
        low, high = _avalanche(low), _avalanche(high)
        for step in range(4, size // 32):
            low, high = round_(low, high, 32 * step, 32 * step + 16, 3 + 32 * (step - 4))
        low, high = round_(low, high, size - 16, size - 32, 136 - 17 - 16)
    mixed = low * _P64[0] + high * _P64[3] + size * _P64[1] & _64
    return (-_avalanche(mixed) & _64) << 64 | _avalanche(low + high & _64)


def _long(data: bytes) -> int:
    sums = [_P32[2], *_P64[:4], _P32[1], _P64[4], _P32[0]]

    def accumulate(position: int, secret: int) -> None:
        for lane in range(8):
            value = _read(data, position + 8 * lane)
            key = value ^ _read(_SECRET, secret + 8 * lane)
            sums[lane ^ 1] = sums[lane ^ 1] + value & _64
            sums[lane] = sums[lane] + (key & 0xFFFFFFFF) * (key >> 32) & _64

    size, block = len(data), _STRIPE * _STRIPES
    blocks = (size - 1) // block
    for number in range(blocks):
        for stripe in range(_STRIPES):
            accumulate(number * block + stripe * _STRIPE, 8 * stripe)
        for lane in range(8):
            value = sums[lane] ^ (sums[lane] >> 47) ^ _read(_SECRET, len(_SECRET) - _STRIPE + 8 * lane)
            sums[lane] = value * _P32[0] & _64
    for stripe in range((size - 1 - blocks * block) // _STRIPE):
        accumulate(blocks * block + stripe * _STRIPE, 8 * stripe)
    accumulate(size - _STRIPE, len(_SECRET) - _STRIPE - 7)

    def merge(start: int, secret: int) -> int:
        for pair in range(4):
            start += _fold(
                sums[2 * pair] ^ _read(_SECRET, secret + 16 * pair),
                sums[2 * pair + 1] ^ _read(_SECRET, secret + 16 * pair + 8),
            )
        return _avalanche(start & _64)

    low = merge(size * _P64[0] & _64, 11)
    high = merge(~(size * _P64[1]) & _64, len(_SECRET) - _STRIPE - 11)
    return high << 64 | low
