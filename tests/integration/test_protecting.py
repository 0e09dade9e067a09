"""What a maintainer gets for a finding, with the rover's planner as a real process: a test, a guard."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.chain.logs import FailingLog
from riot_bus.chain.workspace import Workspace
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.report.regression import write_regression_test
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase

pytestmark = [pytest.mark.integration, pytest.mark.timeout(240)]

ROOT = Path(__file__).parents[2]
FIX = "        if not 0 <= update.x * update.y <= WORKSPACE:\n            update.x = update.y = 0\n"


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "examples/rover", tmp_path / "rover", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.syspath_prepend(str(tmp_path / "rover"))
    return tmp_path / "rover"


def update(x: int, y: int, number: int = 0) -> Message:
    from rover.maps import OccupancyGridUpdate
    from rover.topics import key

    payload = OccupancyGridUpdate((1, 2), x, y, 2, 2, bytes(4)).encode()
    return Message(10**18 + number * 10**8, key("/map_updates"), payload, sequence=number)


def write_finding(rover: Path) -> Path:
    """Write a finding of the planner as the first steps do, with the signature that a trial shows."""
    folder = rover / "riot-out/findings/crash-planner-1"
    folder.mkdir(parents=True)
    with Workspace(rover / "riot.toml", rover / "riot-out", jobs=1) as workspace:
        failing = update(-3, 700)
        (outcome,) = workspace.runners.unit("planner", lambda: ()).run([TestCase((failing,))])
        (violation,) = outcome.violations
        record = FindingRecord(
            id="crash-planner-1", system="rover", system_file=str(rover / "riot.toml"), unit="planner",
            component="planner", monitor=violation.monitor, signature=violation.signature,
        )  # fmt: skip
        record.save(folder)
        MinimalRecord(before=9, kept=(0,), topics=("/map_updates",), one_minimal=True).save(folder)
        log = FailingLog((failing,), {0: update(3, 700)})
        log.save(folder / "minimal.mcap", context=workspace.context, metadata={})
    write_regression_test(folder, record)
    return folder


def pytest_says(folder: Path) -> tuple[int, str]:
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    (file,) = folder.glob("riot_test_*.py")
    command = [sys.executable, "-m", "pytest", file.name, "-q", "-p", "no:cacheprovider", "--rootdir=."]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, timeout=200
    )
    return done.returncode, done.stdout + done.stderr


def test_the_regression_test_fails_today_and_passes_when_the_planner_is_mended(rover: Path) -> None:
    folder = write_finding(rover)
    code, output = pytest_says(folder)
    assert code == 1, output
    assert "3 of 3 trials of minimal.mcap fail: crash in planner" in output
    source = rover / "rover/workspace.py"
    text = source.read_text()
    place = text.index("        return Window(")
    source.write_text(text[:place] + FIX + text[place:])
    code, output = pytest_says(folder)
    assert code == 0, output
    assert not list(folder.glob("**/trials"))
