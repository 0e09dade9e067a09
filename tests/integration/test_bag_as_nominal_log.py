"""A ROS 2 bag with plain topic names is the nominal log of a unit that listens as nodes over rmw_zenoh do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.bags import STRING_HASH, STRING_KEY, VOLATILE, write_bag
from tests.integration.play_tools import BEGIN, MS

pytestmark = pytest.mark.integration

ROOT = Path(__file__).parents[2]
LISTENER = f"""
import json, struct, sys
import zenoh

config = zenoh.Config()
for key, value in {{"mode": "client", "connect/endpoints": [sys.argv[1]], "scouting/multicast/enabled": False}}.items():
    config.insert_json5(key, json.dumps(value))
queue = zenoh.handlers.FifoChannel(1000)
with zenoh.open(config) as session, session.declare_subscriber("*/chatter/{STRING_KEY}", queue) as inbox:
    for sample in inbox:
        if sample.attachment is None:
            continue  # as rmw_zenoh does
        number, time, size = struct.unpack_from("<qqB", sample.attachment.to_bytes())
        assert number > 0 and size == 16
        text = sample.payload.to_bytes()[8:].rstrip(b"\\0").decode(errors="replace")
        if not text.startswith("message"):
            raise SystemExit(3)
"""
SYSTEM = """
[system]
name = "listener"

[components.listener]
command = ["{python}", "listener.py", "{endpoint}"]
inputs = ["/chatter"]

[unit.listener]
log = "bag.mcap"
"""


PLAN = """
[[inject]]
topic = "/chatter"
field = "data"
value = "another"
first = 5
last = 5
"""


def riot(folder: Path, *arguments: str, code: int) -> Any:
    path = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    done = subprocess.run(
        [sys.executable, "-m", "riot_bus", *arguments, "--format=json"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "RIOT_CATALOGUE": str(folder / "c.sqlite")},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == code, done.stderr
    return json.loads(done.stdout)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder with a bag, a unit and its riot.toml."""
    log = [(BEGIN + number * MS, "/chatter", f"message {number}") for number in range(20)]
    write_bag(tmp_path / "bag.mcap", {"/chatter": (VOLATILE, STRING_HASH), "/other": (VOLATILE, STRING_HASH)}, log)
    (tmp_path / "listener.py").write_text(LISTENER)
    (tmp_path / "riot.toml").write_text(SYSTEM)
    return tmp_path


def test_a_unit_is_tested_with_a_bag(work: Path) -> None:
    found = riot(work, "test", "--trials=10", "--jobs=1", code=1)
    assert "crash" in json.dumps(found)


def test_a_test_case_is_replayed_over_bags(work: Path) -> None:
    (work / "plan.toml").write_text(PLAN)
    riot(work, "fleet", "index", ".", code=0)
    run = ["fleet", "run", "plan.toml", "--over=", "--unit=listener"]
    (answer,) = riot(work, *run, code=1)["logs"]
    assert (answer["answer"], answer["injected"], answer["messages"]) == ("failed", 1, 20)
    (work / "listener.py").write_text(LISTENER.replace('"message"', '("message", "another")'))
    (answer,) = riot(work, *run, "--again", code=0)["logs"]
    assert answer["answer"] == "fixed"
