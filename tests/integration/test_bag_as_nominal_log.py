"""A ROS 2 bag with plain topic names is the nominal log of a unit that listens as nodes over rmw_zenoh do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

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


def test_a_unit_is_tested_with_a_bag(tmp_path: Path) -> None:
    log = [(BEGIN + number * MS, "/chatter", f"message {number}") for number in range(20)]
    write_bag(tmp_path / "bag.mcap", {"/chatter": (VOLATILE, STRING_HASH), "/other": (VOLATILE, STRING_HASH)}, log)
    (tmp_path / "listener.py").write_text(LISTENER)
    (tmp_path / "riot.toml").write_text(SYSTEM)
    path = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    done = subprocess.run(
        [sys.executable, "-m", "riot_bus", "test", "--trials=10", "--jobs=1", "--format=json"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    assert "crash" in json.dumps(found)
