"""Libraries of others in thin nodes: a campaign finds what they do without riot, and claims nothing else."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from riot_bus.findings.records import CampaignRecord, FindingRecord
from tests.interop import LIBRARIES, require
from tests.systems.libraries.catalogue import FOLDER, INPUTS, write

pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(1200)]

FOUND = {
    "controller": {"mined finite of answer:output"},
    "tracker": {f"mined finite of answer:{field}" for field in "pvx"},
    "unscented": {"silent of unscented: nothing on answer"},
    "ida_planner": {"hang of ida_planner: in on_query"},
}
RARELY = {"ida_planner": {"crash in ida_planner: on_query: path, runs = finder.find_path(start, end, grid)"}}
"""Needs two fields of one message to have the right values: not every campaign of this length comes upon it."""

TRIALS = {"ida_planner": 300}
"""The wall that encloses a goal has to come into one of two of the 24 cells of a map that is sent three times."""


def test_what_is_claimed_of_the_libraries_they_do_without_riot() -> None:
    done = subprocess.run(
        [require(LIBRARIES), FOLDER / "direct.py"], capture_output=True, text=True, timeout=300, check=True
    )
    assert json.loads(done.stdout) == {
        "the output stays NaN after one NaN": True,
        "not finite after a NaN position": ["v", "x"],
        "not finite after an infinite variance": ["p", "v", "x"],
        "no answers after an infinite variance": True,
        "no answers after a position of 1e300": True,
        "no answers after a step of 1e10": True,
        "A* from a place to itself": 1,
        "A* to an enclosed place": 0,
        "IDA* from a place to itself": "IndexError",
        "IDA* to an enclosed place": "TimeoutError",
    }


@pytest.mark.parametrize("kind", INPUTS)
def test_a_campaign_finds_these_faults_and_claims_no_others(riot, tmp_path: Path, kind: str) -> None:
    system = write(tmp_path, kind, require(LIBRARIES))
    done = riot(
        "test",
        "--system",
        system,
        "--out",
        tmp_path / "out",
        "--trials",
        TRIALS.get(kind, 100),
        "--jobs",
        2,
        timeout=1000,
    )
    record = CampaignRecord.load(tmp_path / "out")
    found = {FindingRecord.load(tmp_path / "out/findings" / name).signature for name in record.findings}
    certain, rarely = FOUND.get(kind, set()), RARELY.get(kind, set())
    assert certain <= found <= certain | rarely, done.stdout + done.stderr
    assert done.returncode == (1 if certain else 0), done.stdout + done.stderr
    assert not record.notes
    assert record.mined["held_out"] > 0
