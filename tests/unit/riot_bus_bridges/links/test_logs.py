"""Telemetry logs as links."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until
from riot_bus_mavlink.tlog import TlogReader, tlog_record
from tests.unit.riot_bus_bridges.links.hosts import WAIT_S, KeepingHost
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame

START = 1_700_000_000 * 10**9
FRAMES = [frame_of(sequence=number) for number in range(5)]


def test_a_log_is_written(tmp_path: Path) -> None:
    file = tmp_path / "out.tlog"
    for _ in range(2):
        with KeepingHost() as host:
            link = host.open(f"tlogwriter:{file}")
            assert link.state == "writing"
            (end,) = host.ends
            assert end.hears_all
            assert not end.receives
            for frame in FRAMES:
                end.send(frame.raw)
        assert link.state == "ended"
    records = TlogReader(COMMON.crc_extra).feed(file.read_bytes() + b"the end, which is no record" * 2)
    assert [record.frame for record in records] == FRAMES * 2
    times = [record.time for record in records]
    assert times == sorted(times)
    assert abs(times[0] / 1e9 - time.time()) < 60
    with KeepingHost() as host, pytest.raises(EnvironmentFaultError, match="cannot be written"):
        host.open(f"tlogwriter:{tmp_path}/none/x.tlog")


@pytest.mark.parametrize(("rate", "least"), [("1", 0.2), ("4", 0.05), ("0", 0.0)])
def test_a_log_is_read_in_its_time(tmp_path: Path, rate: str, least: float) -> None:
    file = tmp_path / "in.tlog"
    frames = [*FRAMES, unknown_frame()]
    times = [START + number * 50_000_000 for number in (0, 1, 2, 1, 3, 4)]
    file.write_bytes(b"".join(tlog_record(at, frame.raw) for at, frame in zip(times, frames, strict=True)))
    wanted = b"".join(frame.raw for frame in frames)
    with KeepingHost() as host:
        begin = time.monotonic()
        link = host.open(f"{file}?rate={rate}")
        assert host.wait(lambda: host.data.get(str(file)) == wanted)
        assert time.monotonic() - begin >= least
        assert wait_until(lambda: link.state == "ended", WAIT_S)
        host.ends[0].send(b"nothing")
        assert (host.ends[0].sends, host.ends[0].lost) == (False, 1)
        assert host.warnings == []


def test_a_damaged_log_is_read_and_said(tmp_path: Path) -> None:
    file = tmp_path / "bad.tlog"
    records = [tlog_record(START, frame.raw) for frame in FRAMES]
    file.write_bytes(records[0] + b"damage" + b"".join(records[1:]) + records[0][:9])
    with KeepingHost() as host:
        host.open(f"tlogreader:{file}?rate=0")
        assert host.wait(lambda: host.data.get(str(file)) == b"".join(frame.raw for frame in FRAMES))
        assert host.wait(lambda: host.warnings == ["15 bytes are not in any record"])
        with pytest.raises(EnvironmentFaultError, match="cannot be read"):
            host.open(f"tlogreader:{tmp_path}/none.tlog")
