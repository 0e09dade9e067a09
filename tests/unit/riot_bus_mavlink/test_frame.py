import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import SIGNATURE, Framer, checksum_fits, pack_frame, parse_frame, trimmed

DIALECT = load_dialect("common")
HEARTBEAT, UNKNOWN = 0, 7_654_321


def heartbeat(sequence=0, version=2, **sender):
    who = {"system": 1, "component": 1} | sender
    body = bytes([sequence, 1, 2, 3, 4, 5, 6, 7, 3])
    return pack_frame(HEARTBEAT, body, DIALECT.crc_extra(HEARTBEAT), version=version, sequence=sequence, **who)


def unknown(size=20):
    return pack_frame(UNKNOWN, bytes([7]) * size, 99, version=2, sequence=3, system=9, component=8)


def framer():
    return Framer(DIALECT.crc_extra)


def balanced(one):
    counts = one.counts
    return counts.bytes == counts.frame_bytes + counts.junk_bytes + len(one._rest)


def test_what_the_header_says():
    (frame,) = framer().feed(heartbeat(5, system=255, component=190))
    assert (frame.version, frame.sequence, frame.system, frame.component) == (2, 5, 255, 190)
    assert (frame.message_id, frame.signed, frame.payload) == (0, False, bytes([5, 1, 2, 3, 4, 5, 6, 7, 3]))
    (old,) = framer().feed(heartbeat(6, 1, system=3))
    assert (old.version, old.sequence, old.system, old.message_id, old.payload[0]) == (1, 6, 3, 0, 6)
    assert parse_frame(old.raw) == old
    assert checksum_fits(old, DIALECT.crc_extra(0))
    assert not checksum_fits(old, 0)


@settings(deadline=None)
@given(st.lists(st.integers(1, 60), max_size=30), st.randoms(use_true_random=False))
def test_however_a_stream_is_split(sizes, draw):
    frames = [draw.choice([heartbeat(n), heartbeat(n, 1), unknown(n + 1)]) for n in range(12)]
    stream = b"".join(frames)
    one, found, at = framer(), [], 0
    for size in [*sizes, len(stream)]:
        found += one.feed(stream[at : at + size])
        at += size
    assert [frame.raw for frame in found] == frames
    assert one.counts.frames == 12
    assert one.counts.unknown == sum(frame.message_id == UNKNOWN for frame in found)
    assert (one.counts.junk_bytes, one.counts.bad_crc, len(one._rest)) == (0, 0, 0)


@settings(deadline=None)
@given(st.lists(st.binary(max_size=40) | st.sampled_from([heartbeat(n, v) for n in range(9) for v in (1, 2)])))
def test_frames_in_junk(parts):
    one = framer()
    found = [frame for part in parts for frame in one.feed(part)]
    assert balanced(one)
    assert one.counts.frame_bytes == sum(len(frame.raw) for frame in found)
    found += one.flush()
    assert len(one._rest) == 0
    assert balanced(one)
    stream, at = b"".join(parts), 0
    for frame in found:  # they are there, one after the other
        at = stream.index(frame.raw, at) + len(frame.raw)


def test_a_damaged_frame_is_dropped_and_the_next_one_found():
    one = framer()
    broken = bytearray(heartbeat(1))
    broken[12] ^= 0x10
    found = one.feed(bytes(broken) + heartbeat(2) + heartbeat(3)) + one.flush()
    assert [frame.sequence for frame in found] == [2, 3]
    assert (one.counts.bad_crc, one.counts.junk_bytes) == (1, len(broken))


def test_a_lost_byte_costs_one_frame():
    whole = [heartbeat(n) for n in range(5)]
    one = framer()
    found = one.feed(whole[0] + whole[1][:7] + whole[1][8:] + b"".join(whole[2:])) + one.flush()
    assert [frame.sequence for frame in found] == [0, 2, 3, 4]
    assert balanced(one)


def test_a_lying_length_hides_no_frame():
    liar = bytes([0xFE, 255, 1, 1, 1, 0])
    one = framer()
    assert one.feed(liar + heartbeat(1)) == []
    assert [frame.sequence for frame in one.flush()] == [1]
    assert (one.counts.junk_bytes, one.counts.bad_crc) == (len(liar), 0)


def test_unknown_messages_pass_where_a_frame_has_to_begin():
    one = framer()
    assert [frame.raw for frame in one.feed(heartbeat() + unknown() + unknown(9))] == [
        heartbeat(),
        unknown(),
        unknown(9),
    ]
    assert one.counts.unknown == 2
    other = framer()
    found = other.feed(b"junk" + unknown() + b"more" + heartbeat(1))
    assert [frame.message_id for frame in found] == [HEARTBEAT]
    assert [frame.raw for frame in other.feed(unknown())] == [unknown()]
    lost = framer()
    assert lost.feed(b"junk") == []
    assert [frame.raw for frame in lost.feed(unknown())] == [unknown()]  # a datagram of its own


def test_flags_that_are_not_defined_are_no_frame():
    raw = bytearray(heartbeat())
    raw[2] = 0x02
    one = framer()
    assert one.feed(bytes(raw)) == []
    with pytest.raises(PayloadError, match="flags that are not defined"):
        parse_frame(bytes(raw))


@pytest.mark.parametrize("data", [b"", b"\xfd", b"\xfe" * 7, b"\x00" * 20, heartbeat() + b"\0", heartbeat()[:-1]])
def test_what_is_not_one_frame(data):
    with pytest.raises(PayloadError):
        parse_frame(data)


def test_trailing_zeros():
    assert trimmed(b"\1\0\0") == b"\1"
    assert trimmed(b"\0\0") == b"\0"
    raw = pack_frame(0, bytes(9), 50, version=2, sequence=256 + 7, system=1, component=1)
    assert (raw[1], raw[4], len(raw)) == (1, 7, 13)
    with pytest.raises(ValueError, match="not the id of a message"):
        pack_frame(1 << 24, b"", 0, version=2, sequence=0, system=1, component=1)


def test_signed_frames_are_longer():
    raw = bytearray(heartbeat())
    raw[2] = 1
    one = framer()
    assert one.feed(bytes(raw)) == []
    assert len(one._rest) == len(raw)
    one.feed(bytes(SIGNATURE))
    assert one.counts.bad_crc == 1  # the flag is part of what is checked
    assert balanced(one)


def test_hostile_streams_take_bounded_work():
    draw = random.Random(3)
    one = framer()
    for first in (b"\xfe", b"\xfd\xff\x00", b"\xfd\xff\x01", b"\xfe\xff"):
        one.feed(first * 3_000)
        assert len(one._rest) < 300
    one.feed(draw.randbytes(20_000))
    assert balanced(one)
