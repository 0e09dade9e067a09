"""Mutated frames, split and joined at random: nothing is raised, frames are found again, counts balance.

RIOT_FUZZ_FRAMES says how many mutated frames there are.
"""

import os
import random
from typing import NamedTuple

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import KIND, Frame, Framer, checksum_fits, pack_frame
from riot_bus_mavlink.message_type import PREFIX
from riot_bus_mavlink.signing import Renewer, Signer
from riot_bus_mavlink.tlog import TlogReader, tlog_record
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame

FRAMES = int(os.environ.get("RIOT_FUZZ_FRAMES", "40000"))
BLOCK = 200
CLEAN = 40
FOUND_AGAIN = 5
"""Of the sound frames after each block, so many of the last ones are found whatever came before."""

ADAPTER = MavlinkAdapter()
DIALECT = ADAPTER.dialect
SIGNER = Signer(bytes(range(32)))


class Known(NamedTuple):
    extra: bytes


def sound_frames(draw):
    """Some frames of both versions, some signed, some of unknown messages."""
    found = []
    for message in draw.sample(sorted(DIALECT.messages.values(), key=lambda each: each.id), 60):
        body = draw.randbytes(message.size)
        who = {"sequence": draw.randrange(256), "system": draw.randrange(256), "component": draw.randrange(256)}
        raw = pack_frame(message.id, body, message.crc_extra, version=2, **who)
        found.append(raw)
        found.append(sign_frame(raw, SIGNER, message.crc_extra, link=1, time=draw.randrange(1 << 40)))
        if message.id < 256:
            found.append(pack_frame(message.id, body[: message.base_size], message.crc_extra, version=1, **who))
    who = {"version": 2, "sequence": 1, "system": 1, "component": 1}
    return found + [pack_frame(9_999_999 - n, draw.randbytes(20), 0, **who) for n in range(9)]


def mutated(draw, raw, other):
    data = bytearray(raw)
    for _ in range(draw.choice((1, 1, 1, 2, 5))):
        at = draw.randrange(len(data)) if data else 0
        match draw.randrange(9):
            case 0 if data:
                data[at] ^= 1 << draw.randrange(8)
            case 1 if data:
                data[at] = draw.choice((0, 0xFD, 0xFE, 0xFF, draw.randrange(256)))
            case 2:
                del data[at : at + draw.choice((1, 1, 2, 10, 300))]
            case 3:
                data[at:at] = draw.randbytes(draw.choice((1, 1, 3, 20)))
            case 4 if len(data) > 1:
                data[1] = draw.randrange(256)
            case 5 if len(data) > 2:
                data[2] = draw.randrange(256)
            case 6:
                data[at:] = other[draw.randrange(len(other)) :]
            case 7:
                data += data[:at]
            case _:
                data[at:at] = bytes((draw.choice((0xFD, 0xFE)),)) * draw.choice((1, 2, 30))
    return bytes(data)


def split(draw, data):
    at = 0
    while at < len(data):
        size = draw.choice((1, 2, 7, 64, 280, 1500, 4096))
        yield data[at : at + size]
        at += size


def test_mutated_streams():
    draw = random.Random(20_261)
    frames = sound_frames(draw)
    framer, renewer = Framer(DIALECT.crc_extra), Renewer(SIGNER)
    made = passed = changed = 0
    while made < FRAMES:
        stream = b"".join(mutated(draw, draw.choice(frames), draw.choice(frames)) for _ in range(BLOCK))
        made += BLOCK
        clean = [draw.choice(frames[:150]) for _ in range(CLEAN)]
        found = [frame for part in split(draw, stream + b"".join(clean)) for frame in framer.feed(part)]
        found += framer.flush()
        assert [frame.raw for frame in found[-FOUND_AGAIN:]] == clean[-FOUND_AGAIN:]
        counts = framer.counts
        assert counts.bytes == counts.frame_bytes + counts.junk_bytes
        passed += len(found)
        assert counts.frames == passed
        for frame in found[:: max(1, len(found) // 20)]:
            changed += use(draw, frame, renewer)
    assert framer.counts.bad_crc > made // 10
    assert framer.counts.unknown < passed // 4
    assert changed > made // 100


def test_mutated_packets_are_taken_together_as_they_are_one_by_one():
    draw = random.Random(31)
    frames = sound_frames(draw)
    together, alone = Framer(DIALECT.crc_extra), Framer(DIALECT.crc_extra)
    kinds: dict[bytes, Known] = {}
    made = known = 0
    while made < FRAMES:
        packets = [
            mutated(draw, each, draw.choice(frames)) if draw.random() < 0.3 else each
            for each in draw.choices(frames, k=BLOCK)
        ]
        made += BLOCK
        found: list[bytes] = []
        at = 0
        while at < BLOCK:
            taken = len(together.known(packets, at, kinds))
            found += packets[at : at + taken]
            at, known = at + taken, known + taken
            for packet in packets[at : at + 1]:
                for frame in together.feed(packet):
                    found.append(frame.raw)
                    extra = DIALECT.crc_extra(frame.message_id)
                    if frame.version == 2 and extra is not None and len(kinds) < 40:
                        kinds[frame.raw[KIND]] = Known(bytes([extra]))
                at += 1
        assert found == [frame.raw for packet in packets for frame in alone.feed(packet)]
        assert together.counts == alone.counts
        assert together._rest == alone._rest
    assert known > made // 20


def use(draw, frame: Frame, renewer: Renewer) -> int:
    """Do to a frame what a bridge and a campaign do; return whether it could be changed."""
    renewer.renew(frame.raw)
    extra = DIALECT.crc_extra(frame.message_id)
    kind = ADAPTER.type_named(PREFIX + DIALECT.name_of(frame.message_id))
    assert (kind is None) == (extra is None)
    if kind is None:
        return 0
    assert checksum_fits(frame, extra)
    try:
        leaf = draw.choice(kind.leaves(frame.raw, elements=300))
        kind.exceptional(frame.raw, leaf.path)
        value = "text" if leaf.type == "string" else draw.choice((0, 1, -1, 1 << 70, 1e300))
        after = kind.patch(frame.raw, {leaf.path: value})
    except PayloadError:
        return 0
    (again,) = Framer(DIALECT.crc_extra).feed(after)
    assert again.raw == after
    return 1


def test_mutated_telemetry_logs():
    draw = random.Random(7)
    frames = sound_frames(draw)
    reader = TlogReader(DIALECT.crc_extra)
    made = passed = 0
    time = 1_700_000_000 * 10**9
    while made < FRAMES // 4:
        records = [tlog_record(time + n, draw.choice(frames)) for n in range(BLOCK)]
        damaged = [mutated(draw, each, draw.choice(records)) if draw.random() < 0.5 else each for each in records]
        stream = b"".join(damaged)
        made += BLOCK
        clean = [draw.choice(frames[:150]) for _ in range(CLEAN)]
        whole = stream + b"".join(tlog_record(time, raw) for raw in clean)
        found = [record for part in split(draw, whole) for record in reader.feed(part)] + reader.flush()
        assert [record.frame.raw for record in found[-FOUND_AGAIN:]] == clean[-FOUND_AGAIN:]
        passed += len(found)
        counts = reader.counts
        assert counts.bytes == counts.frame_bytes + counts.junk_bytes
        assert counts.frames == passed
