"""What disks and folders can do to a recording, and that neither traffic nor counts suffer from it."""

from __future__ import annotations

import contextlib
import json
import resource
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.control.remote import Remote
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import assert_rows_balance, crosses, everything
from tests.integration.router_process import RouterProcess, failing

pytestmark = pytest.mark.integration

COUNT = 3000
PADDING = 2000
SMALL = 2_500_000


@contextlib.contextmanager
def flooded(router: RouterProcess) -> Iterator[tuple[Puppet, Puppet]]:
    """Components of which one floods `cut/x`; the other has received everything."""
    with Puppet(router.endpoints["system"]) as source, Puppet(router.endpoints["unit"]) as sink:
        sink.do("subscribe_numbers", key="cut/x")
        sink.do("subscribe", key="route")  # the last: once it is known, so is the other
        assert crosses(source, sink, "route", "there")
        source.start("flood", key="cut/x", count=COUNT, padding=PADDING, noise=True)
        assert sink.do("wait_numbers", count=COUNT) == everything(COUNT)
        source.answer()
        yield source, sink


def row_of(remote: Remote, topic: str) -> dict[str, Any]:
    row: dict[str, Any] = remote.ask("counts")["counts"].get(topic, {"recorded": 0, "unrecorded": 0})
    return row


def written(log: Path, key: str) -> int:
    with LogReader(log) as reader:
        return sum(message.key == key for message in reader.messages())


def settled(remote: Remote) -> bool:
    row = row_of(remote, "cut/x")
    return bool(row["unrecorded"] and row["recorded"] + row["unrecorded"] == COUNT)


def test_a_full_disk_costs_the_recording_alone_and_every_message_of_it_is_counted(tmp_path: Path) -> None:
    log, other = tmp_path / "a.mcap", tmp_path / "b.mcap"
    with RouterProcess("--intercept=cut/**", f"--record={log}", "--format=json") as router:
        _, most = resource.prlimit(router.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(router.process.pid, resource.RLIMIT_FSIZE, (SMALL, most))
        with flooded(router) as (source, sink), Remote(router.endpoints["unit"]) as remote:
            assert wait_until(lambda: settled(remote), 60)
            row = row_of(remote, "cut/x")
            assert (row["received"], row["forwarded"], row["lost"]) == (COUNT, COUNT, 0)
            assert 0 < row["recorded"] < COUNT
            assert "File too large" in remote.ask("status")["recording"]["problem"]
            resource.prlimit(router.process.pid, resource.RLIMIT_FSIZE, (most, most))
            assert crosses(source, sink, "route", "now there is room again")
            assert wait_until(lambda: remote.ask("status")["recording"]["problem"] == "", 60)
            remote.ask("record/split", json.dumps({"path": "b.mcap"}).encode())
            source.do("put_texts", key="cut/after", payloads=["x"] * 100, congestion="BLOCK")
            assert wait_until(lambda: row_of(remote, "cut/after")["recorded"] == 100, 60)
            row = row_of(remote, "cut/x")  # the last chunk of the former file may have failed after all
            assert row["recorded"] + row["unrecorded"] == COUNT
            assert written(log, "cut/x") == row["recorded"]
            assert written(log, "route") > 0
            assert row_of(remote, "cut/x") == row
        code, out, err = router.end(signal.SIGTERM)
    ended = json.loads(out.splitlines()[-1])
    assert code == 3, err
    assert ended["counts"]["cut/x"]["unrecorded"] == COUNT - row["recorded"]
    assert ended["losses"]["recordings"] >= COUNT - row["recorded"]
    assert err.count("the log cannot be written: File too large") == 1
    assert "Traceback" not in err
    assert written(other, "cut/after") == 100


def test_a_disk_that_is_full_at_the_end_is_no_crash(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    with RouterProcess("--intercept=cut/**", f"--record={log}", "--format=json") as router:
        resource.prlimit(router.process.pid, resource.RLIMIT_FSIZE, (10, resource.RLIM_INFINITY))
        with Puppet(router.endpoints["system"]) as source, Puppet(router.endpoints["unit"]) as sink:
            sink.do("subscribe", key="**")
            assert crosses(source, sink, "cut/x", "there")
            code, out, err = router.end(signal.SIGTERM)
    row = json.loads(out.splitlines()[-1])["counts"]["cut/x"]
    assert (code, row["recorded"], row["unrecorded"]) == (3, 0, row["forwarded"]), err
    assert row["forwarded"] > 0
    assert "Traceback" not in err


def test_a_folder_that_vanishes_takes_the_recording_along_and_that_is_counted(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    log = folder / "a.mcap"
    with RouterProcess("--intercept=cut/**", f"--record={log}", "--format=json") as router:
        with flooded(router) as (source, sink), Remote(router.endpoints["unit"]) as remote:
            assert wait_until(lambda: row_of(remote, "cut/x")["recorded"] == COUNT, 60)
            shutil.rmtree(folder)
            assert wait_until(lambda: row_of(remote, "cut/x")["unrecorded"] == COUNT, 60)
            assert row_of(remote, "cut/x")["recorded"] == 0
            for path in ("b.mcap", None):
                with pytest.raises(ConfigError, match=r"no folder|cannot write"):
                    remote.ask("record/split", json.dumps({"path": path}).encode())
            assert crosses(source, sink, "route", "goes on")
            counts = remote.ask("counts")["counts"]
            assert_rows_balance({topic: {**row, "balanced": 0} for topic, row in counts.items()})
            assert (counts["cut/x"]["forwarded"], counts["cut/x"]["lost"]) == (COUNT, 0)
        code, _, err = router.end(signal.SIGTERM)
    assert code == 3, err
    assert err.count("the file was removed") == 1
    assert "Traceback" not in err


@pytest.mark.parametrize("path", ["/dev/full", "/proc/a.mcap", "/dev/null/a.mcap", "missing/a.mcap"])
def test_a_recording_that_cannot_be_written_at_all_is_an_error_at_once(path: str, tmp_path: Path) -> None:
    log = path if path.startswith("/") else str(tmp_path / path)
    code, err = failing(["--segment=a=tcp/127.0.0.1:0", "--segment=b=tcp/127.0.0.1:0", f"--record={log}"])
    assert code == 2, err
    assert f"{log}: cannot write the log" in err
    assert "Traceback" not in err


def test_a_recording_of_a_killed_router_holds_what_was_said_to_be_recorded_a_second_before(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    with RouterProcess("--intercept=cut/**", f"--record={log}") as router, flooded(router):
        assert wait_until(lambda: written(log, "cut/x") == COUNT, 60, interval=0.05)
        router.process.kill()
        router.process.wait(60)
    with LogReader(log) as reader:
        numbers = [int.from_bytes(each.payload[:8], "little") for each in reader.messages() if each.key == "cut/x"]
        assert reader.loss.unfinished
    assert numbers == list(range(COUNT))
