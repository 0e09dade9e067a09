import io

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil

from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import pack_frame, parse_frame
from riot_bus_mavlink.tlog import TlogReader, TlogRecord, tlog_record

COMMON = load_dialect("common")
START = 1_700_000_000 * 10**9


def frame(number, version=2, message_id=0):
    extra = COMMON.crc_extra(message_id) or 0
    body = bytes([number, 1, 2, 3, 4, 5, 6, 7, 3])
    return pack_frame(message_id, body, extra, version=version, sequence=number, system=1, component=1)


def records(count=10):
    return [
        (START + n * 1_000_000, frame(n, 1 if n % 3 == 0 else 2, 0 if n % 4 else 99 if n % 3 == 0 else 999_999))
        for n in range(count)
    ]


def read(data, *sizes):
    reader, found, at = TlogReader(COMMON.crc_extra), [], 0
    for size in (*sizes, len(data)):
        found += reader.feed(data[at : at + size])
        at += size
    found += reader.flush()
    counts = reader.counts
    assert len(reader._rest) == 0
    assert counts.bytes == counts.frame_bytes + counts.junk_bytes == len(data)
    assert counts.frames == len(found)
    return found, counts


@settings(deadline=None)
@given(st.lists(st.integers(1, 100), max_size=20))
def test_what_was_written_is_read(sizes):
    wanted = [(time, raw) for time, raw in records()]
    found, counts = read(b"".join(tlog_record(*each) for each in wanted), *sizes)
    assert [(time, each.raw) for time, each in found] == wanted
    assert (counts.bad_crc, counts.junk_bytes, counts.unknown) == (0, 0, 3)


@settings(deadline=None)
@given(st.data())
def test_damage_costs_little(data):
    wanted = [(START + n * 1_000_000, frame(n)) for n in range(12)]
    whole = b"".join(tlog_record(*each) for each in wanted)
    at = data.draw(st.integers(0, len(whole) - 1))
    end = min(len(whole), at + data.draw(st.integers(0, 20)))
    broken = whole[:at] + data.draw(st.binary(max_size=20)) + whole[end:]
    found, _ = read(broken)
    touched = len({place // 29 for place in range(at, max(end, at + 1))})
    sound = {raw for _, raw in wanted}
    kept = [each for each in found if each.frame.raw in sound]
    assert len(kept) >= 12 - touched - 2


def test_a_damaged_record_among_sound_ones():
    parts = [bytearray(tlog_record(*each)) for each in records()]
    parts[5][20] ^= 1
    found, counts = read(b"".join(map(bytes, parts)))
    assert len(found) == 9
    assert (counts.bad_crc, counts.junk_bytes) == (1, len(parts[5]))


def test_files_that_are_no_logs():
    for data in (b"", b"\xfd" * 3_000, b"\xfe" * 3_000, b"not a log at all, and quite long" * 100, bytes(5_000)):
        found, counts = read(data)
        assert found == []
        assert counts.junk_bytes == len(data)


def test_pymavlink_reads_it_and_is_read(tmp_path):
    ours = tmp_path / "ours.tlog"
    wanted = [(time, raw) for time, raw in records() if parse_frame(raw).message_id == 0]
    ours.write_bytes(b"".join(tlog_record(*each) for each in wanted))
    log = mavutil.mavlink_connection(str(ours), dialect="common", notimestamps=False)
    theirs = []
    while (message := log.recv_match()) is not None:
        theirs.append((round(message._timestamp * 1e6) * 1_000, bytes(message.get_msgbuf())))
    log.close()
    assert theirs == wanted
    written = io.BytesIO()
    for time, raw in wanted:
        written.write((time // 1_000).to_bytes(8) + raw)
    assert [TlogRecord(time, parse_frame(raw)) for time, raw in wanted] == read(written.getvalue())[0]
