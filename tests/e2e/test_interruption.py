"""kill -9, Ctrl-C, SIGTERM and a full disk at any moment lose no finished trial; the same command goes on."""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest
from e2e_support import belonging_to, command, environment

from riot_bus.campaign.store import TrialStore, stored_trials
from riot_bus.chain.base.logs import FailingLog
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.trial.context import open_system
from riot_bus.zenoh.session import wait_until
from tests.systems.misbehaviour.catalogue import write
from tests.tiers import scaled

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

UNIT = "segfaults"
SIGNATURES = {
    "crash in segfaults: SIGSEGV in poke_large < misbehave < handle",
    "crash in segfaults: SIGSEGV in poke_not_finite < misbehave < handle",
}
TRIALS = 100


@pytest.fixture
def system(tmp_path: Path) -> Path:
    """A folder of its own, so that its processes can be told from those of other tests."""
    (tmp_path / "system").mkdir()
    return write(tmp_path / "system")


def arguments(system: Path, out: Path) -> tuple[object, ...]:
    return ("test", "--system", system, "--unit", UNIT, "--out", out, "--trials", TRIALS, "--jobs", 2)


def stored(out: Path) -> dict[object, object]:
    """Return the number of each trial in the store, by test case; one that is executed again has another number."""
    return {row["key"]: row["number"] for row in stored_trials(out / "trials" / TrialStore.NAME)}


def findings(out: Path) -> set[str]:
    """Return the signatures of all findings; each can be read whole."""
    folders = [path.parent for path in (out / "findings").glob(f"*/{FindingRecord.FILE}")]
    records = [FindingRecord.load(folder) for folder in folders]
    for folder, record in zip(folders, records, strict=True):
        registry = open_system(Path(record.system_file)).registry
        log = FailingLog.load(folder / "failure.mcap", registry=registry)
        assert (len(log.messages), len(log.originals)) == (record.messages, record.modified)
        assert (folder / "reproduce.sh").is_file() or not CampaignRecord.exists(out)
    return {record.signature for record in records}


def interrupt(system: Path, out: Path, tmp_path: Path, numbers: Sequence[signal.Signals]) -> None:
    """Interrupt a campaign with signals at random moments, each time run on; then let it finish."""
    rest = random.Random(str(tmp_path))
    before: dict[object, object] = {}
    known: set[str] = set()
    for number in numbers:
        running = subprocess.Popen(
            command(*arguments(system, out)), env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        more = len(before) + rest.randint(0, 2)
        wait_until(lambda: len(stored(out)) > more or running.poll() is not None, 120)  # noqa: B023
        seen = stored(out)
        assert running.poll() is None, "the campaign ended before it could be interrupted"
        running.send_signal(number)
        _, errors = running.communicate(timeout=60)
        assert wait_until(lambda: not belonging_to(tmp_path), 60), belonging_to(tmp_path)
        kept, signatures = stored(out), findings(out)
        assert before.items() <= seen.items() <= kept.items(), "a finished trial is lost, or was executed twice"
        assert known <= signatures <= SIGNATURES, "a finding is gone"
        if number is signal.SIGKILL:
            assert running.returncode == -number
        else:
            assert running.returncode == 130, errors.decode()
            told = re.search(rb"interrupted; kept in (.+): (\d+) finished trials?, (\d+) findings?", errors)
            assert told, errors
            assert (int(told[2]), int(told[3])) == (len(kept), len(signatures))
        before, known = kept, signatures
    again = subprocess.run(
        command(*arguments(system, out)), env=environment(), capture_output=True, text=True, timeout=300
    )
    assert again.returncode == 1, again.stderr
    assert before.items() <= stored(out).items()
    assert findings(out) == SIGNATURES
    assert CampaignRecord.load(out).tested == TRIALS + 4
    assert not belonging_to(tmp_path)


@pytest.mark.parametrize(
    "numbers",
    [
        (signal.SIGKILL, signal.SIGTERM),
        pytest.param((signal.SIGKILL,) * 5, marks=pytest.mark.nightly),
        pytest.param((signal.SIGTERM, signal.SIGINT) * 3, marks=pytest.mark.nightly),
    ],
)
def test_interrupted_campaign(system: Path, tmp_path: Path, numbers: Sequence[signal.Signals]) -> None:
    for round_ in range(scaled(4, gate=1)):
        interrupt(system, tmp_path / f"out{round_}", tmp_path, numbers)


def test_full_disk_loses_nothing_and_is_no_failure(system: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    growing = out / "trials" / f"{TrialStore.NAME}-wal"
    running = subprocess.Popen(
        command(*arguments(system, out)), env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert wait_until(lambda: stored(out), 120)
    before, limit = stored(out), growing.stat().st_size + 100  # half of an outcome
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (limit, limit))
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 4, errors
    assert b"Traceback" not in errors, errors.decode()
    assert b"make room and run the same command again" in errors
    assert wait_until(lambda: not belonging_to(tmp_path), 60), belonging_to(tmp_path)
    kept = stored(out)
    assert before.items() <= kept.items()
    again = subprocess.run(command(*arguments(system, out)), env=environment(), capture_output=True, timeout=300)
    assert again.returncode == 1, again.stderr
    assert kept.items() <= stored(out).items()
    assert findings(out) == SIGNATURES


def test_killed_process_group_leaves_nothing(system: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    running = subprocess.Popen(command(*arguments(system, out)), env=environment(), start_new_session=True)
    assert wait_until(lambda: stored(out), 120)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait(timeout=10)
    assert wait_until(lambda: not belonging_to(tmp_path), 60), belonging_to(tmp_path)
