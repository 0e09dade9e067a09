import random

import pytest

from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import SIGNATURE, Framer, pack_frame, parse_frame
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.signing import (
    Renewer,
    Signer,
    key_of_phrase,
    link_of,
    read_key,
    time_of,
)
from tests.unit.riot_bus_mavlink.oracle import KEY, Oracle, plain
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame

COMMON = load_dialect("common")


def attitude(*, system=1, time=100, link=3, key=KEY):
    message = COMMON.message("ATTITUDE")
    raw = pack_frame(30, b"\1" * 28, message.crc_extra, version=2, sequence=1, system=system, component=1)
    return sign_frame(raw, Signer(key), message.crc_extra, link=link, time=time)


def test_signatures_are_those_of_pymavlink():
    oracle = Oracle("common", key=KEY)
    for message in COMMON.messages.values():
        raw = oracle.pack(message.id, plain(message, 3), timestamp=987_654_321)
        frame = parse_frame(raw)
        assert Signer(KEY).made(frame.raw)
        assert not Signer(bytes(32)).made(frame.raw)
        assert (time_of(frame), link_of(frame)) == (987_654_321, 5)
        plain_raw = Oracle("common").pack(message.id, plain(message, 3))
        assert sign_frame(plain_raw, Signer(KEY), message.crc_extra, link=5, time=987_654_321) == raw


def test_pymavlink_accepts_what_was_changed_and_renewed():
    receiver = Oracle("common", key=KEY)
    receiver.mav.signing.timestamp = (1_700_000_000 - 1_420_070_400) * 100_000  # of 10 us
    kind = MavlinkType(COMMON.message("ATTITUDE"), COMMON.enums, signer=Signer(KEY))
    renewer = Renewer(Signer(KEY))
    start = receiver.mav.signing.timestamp
    draw = random.Random(1)
    for number in range(200):
        raw = attitude(time=start + draw.randrange(50) - (number % 3), link=number % 2)
        if number % 4:
            raw = kind.patch(raw, {"roll": float(number)})
        sent = renewer.renew(raw)
        message = receiver.mav.decode(bytearray(sent))  # raises if it is not newer than the last one
        assert message.roll == kind.read(raw, "roll")
    assert (receiver.mav.signing.goodsig_count, receiver.mav.signing.badsig_count) == (200, 0)


def test_times_that_grow_are_left_alone():
    renewer = Renewer(Signer(KEY))
    first, second = attitude(time=100), attitude(time=101)
    assert [renewer.renew(raw) for raw in (first, second)] == [first, second]
    repeated = parse_frame(renewer.renew(first))
    assert (time_of(repeated), Signer(KEY).made(repeated.raw)) == (102, True)
    other = attitude(time=5, system=2)
    assert renewer.renew(other) == other
    assert renewer.renew(attitude(time=5, link=4)) == attitude(time=5, link=4)
    played = parse_frame(renewer.renew(attitude(time=103), now=5_000))
    assert time_of(played) == 5_000
    assert max(renewer._last.values()) == 5_000


def test_senders_without_end_take_bounded_memory():
    signer, sent = Signer(KEY), 1 << 15
    renewer = Renewer(signer)
    template = attitude()
    for number in range(sent):
        raw = signer.sign(template[:5] + number.to_bytes(2) + template[7:-SIGNATURE], template[-13], 100)
        assert renewer.renew(raw) == raw
    assert len(renewer._last) == 1 << 14
    assert time_of(parse_frame(renewer.renew(raw))) == 101


def test_what_is_not_signed_is_left_alone():
    raw = attitude()
    unsigned = pack_frame(30, b"\1" * 28, 39, version=2, sequence=1, system=1, component=1)
    for each in (unsigned, b"", b"\xfe\0\0\0\0\0\0\0", raw[:20]):
        assert Renewer(Signer(KEY)).renew(each) == each


def test_nobody_gets_a_signature_who_has_none():
    renewer, last = Renewer(Signer(KEY)), (1 << 48) - 1
    forged = [attitude(time=time, key=bytes(32)) for time in (100, 50, last)]
    assert renewer.renew(attitude(time=70)) == attitude(time=70)
    assert [renewer.renew(raw) for raw in forged] == forged
    assert dict(renewer._last) == {b"\3\1\1": 70}
    assert time_of(parse_frame(renewer.renew(attitude(time=70)))) == 71


def test_time_ends():
    renewer = Renewer(Signer(KEY))
    last = attitude(time=(1 << 48) - 1)
    assert renewer.renew(last) == last
    with pytest.raises(PayloadError, match="no later time"):
        renewer.renew(last)


def test_a_framer_gives_signed_frames():
    raw = attitude()
    (frame,) = Framer(COMMON.crc_extra).feed(raw)
    assert frame.signed
    assert frame.raw == raw
    assert len(frame.payload) == len(raw) - 12 - SIGNATURE


def test_keys(tmp_path):
    file = tmp_path / "key"
    for content, key in (
        (KEY, KEY),
        (KEY.hex().encode() + b"\n", KEY),
        (b"open sesame\n", key_of_phrase("open sesame")),
        (b"p" * 31 + b"\n", key_of_phrase("p" * 31)),
        (b"\x80" * 31 + b"\n", b"\x80" * 31 + b"\n"),
        (b"abcd", key_of_phrase("abcd")),
    ):
        file.write_bytes(content)
        assert read_key(file) == key
    for content in (b"", b"two\nlines", b"\xff\xfe", b"x" * 2_000):
        file.write_bytes(content)
        with pytest.raises(ConfigError, match="not a key"):
            read_key(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_key(tmp_path / "none")
    with pytest.raises(ConfigError, match="32 bytes"):
        Signer(b"short")
    assert KEY.hex() not in repr(Signer(KEY))
