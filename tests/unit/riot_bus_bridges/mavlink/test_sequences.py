"""Gaps in sequence numbers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.mavlink.sequences import LinkLosses, OwnStreams
from riot_bus_mavlink.frame import Frame, checksum_fits, parse_frame
from riot_bus_mavlink.signing import Signer
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame


@given(st.integers(0, 255), st.lists(st.integers(0, 255), max_size=40))
def test_gaps_are_counted(first: int, gaps: list[int]) -> None:
    losses = LinkLosses()
    number = first
    assert losses.see(1, 2, number) == 0
    for gap in gaps:
        number = (number + 1 + gap) % 256
        assert losses.see(1, 2, number) == gap
    count = losses.counts()[1, 2]
    assert (count.received, count.lost, count.last) == (len(gaps) + 1, sum(gaps), number)


def test_sources_have_counts_of_their_own_and_are_bounded() -> None:
    losses = LinkLosses()
    for component in (1, 2):
        for number in (5, 6, 7):
            assert losses.see(1, component, number) == 0
    assert [each.lost for each in losses.counts().values()] == [0, 0]
    for source in range(1 << 16):
        losses.see(source >> 8, source & 255, 0)
    assert len(losses.counts()) == 4096


SIGNER = Signer(bytes(range(32)))


def signed_frame(sequence: int) -> Frame:
    frame = frame_of(sequence=sequence)
    extra = COMMON.crc_extra(frame.message_id)
    assert extra is not None
    return parse_frame(sign_frame(frame.raw, SIGNER, extra, link=3, time=1234))


@pytest.mark.parametrize("version", [1, 2])
def test_inserted_frames_are_numbered_by_source(version: int) -> None:
    streams = OwnStreams(COMMON.crc_extra)
    numbers = []
    for _ in range(258):
        frame = frame_of("ATTITUDE", sequence=77, version=version, roll=0.5)
        renewed = parse_frame(streams.renumber(frame))
        extra = COMMON.crc_extra(renewed.message_id)
        assert extra is not None
        assert checksum_fits(renewed, extra)
        assert (renewed.payload, renewed.system, renewed.version) == (frame.payload, 1, version)
        numbers.append(renewed.sequence)
    assert numbers == [*range(256), 0, 1]
    other = parse_frame(streams.renumber(frame_of(source=(1, 9), sequence=77)))
    assert other.sequence == 0


def test_what_cannot_be_sealed_stays_as_it_is() -> None:
    streams = OwnStreams(COMMON.crc_extra)
    for frame in (unknown_frame(sequence=9), signed_frame(9)):
        assert streams.renumber(frame) == frame.raw


def test_signed_frames_are_signed_anew_with_the_key() -> None:
    renewed = parse_frame(OwnStreams(COMMON.crc_extra, SIGNER).renumber(signed_frame(9)))
    assert (renewed.sequence, renewed.signed, SIGNER.made(renewed.raw)) == (0, True, True)
    forged = parse_frame(renewed.raw[:-1] + bytes([renewed.raw[-1] ^ 1]))
    assert not SIGNER.made(forged.raw)
    assert OwnStreams(COMMON.crc_extra, SIGNER).renumber(forged) == forged.raw
