"""A part of the damaged payloads that `python -m tests.cdr_mutants` tries, with its limit of memory."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tiers import scaled

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")

MUTANTS = scaled(3400)
ROOT = Path(__file__).parents[3]


def test_nothing_but_payload_errors_comes_out():
    command = [sys.executable, "-m", "tests.cdr_mutants", "--mutants", str(MUTANTS), "--seed", "7", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, timeout=280)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    found = json.loads(done.stdout)
    assert found["mutants"] >= MUTANTS
    assert found["types"] >= 50
    assert found["failures"] == []
    assert found["acts"]["refused"] > MUTANTS // 4
    assert found["acts"]["taken"] > MUTANTS // 4
