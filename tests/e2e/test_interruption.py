"""kill -9 and Ctrl-C at any moment leave no process behind, and the same command goes on where it stopped."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from e2e_support import belonging_to, command, environment

from riot_bus.zenoh.session import wait_until

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

PRESS = Path(__file__).resolve().parents[1] / "systems" / "press"


@pytest.fixture
def press(tmp_path: Path) -> Path:
    """A copy of the press, so that its processes can be told from those of other tests."""
    shutil.copytree(PRESS, tmp_path / "press", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "press" / "riot.toml"


def trials(out: Path) -> int:
    store = out / "trials" / "trials.jsonl"
    return store.read_bytes().count(b"\n") if store.exists() else 0


@pytest.mark.parametrize(("number", "code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_interrupted_campaign(press: Path, tmp_path: Path, number: signal.Signals, code: int) -> None:
    out = tmp_path / "out"
    arguments = ("test", "--system", press, "--out", out, "--trials", 14, "--format", "json")
    running = subprocess.Popen(
        command(*arguments), env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    moment = random.Random(str(tmp_path)).randint(1, 6)
    assert wait_until(lambda: trials(out) >= moment, 120)
    before = trials(out)
    running.send_signal(number)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == code, errors
    assert "Traceback" not in errors
    assert wait_until(lambda: not belonging_to(tmp_path), 60), belonging_to(tmp_path)

    again = subprocess.run(command(*arguments), env=environment(), capture_output=True, text=True, timeout=300)
    assert again.returncode in (0, 1), again.stderr
    assert json.loads(again.stdout)["unit"] == "drive"
    assert trials(out) >= 16  # 14 injected ones and the two nominal ones
    keys = [json.loads(line)["key"] for line in (out / "trials" / "trials.jsonl").read_text().splitlines()]
    assert len(keys) == len(set(keys)), "a trial was executed twice"
    assert before >= moment
    assert not belonging_to(tmp_path)


def test_killed_router_process_group_leaves_nothing(press: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ("test", "--system", press, "--out", out, "--trials", 14)
    running = subprocess.Popen(command(*arguments), env=environment(), start_new_session=True)
    assert wait_until(lambda: trials(out) >= 1, 120)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait(timeout=10)
    assert wait_until(lambda: not belonging_to(tmp_path), 60), belonging_to(tmp_path)
