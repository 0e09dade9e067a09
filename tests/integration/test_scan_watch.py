"""`riot scan --watch` on a real bus: warns before the rule is met, and says at its end what came of it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.router.bus import Bus
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from tests.unit.riot_bus_fleet.test_scan import FAST, write_rule

pytestmark = pytest.mark.integration


def test_who_looks_on_is_warned_before_the_rule_is_met(tmp_path: Path) -> None:
    rule = write_rule(tmp_path / "rule", FAST, "a", a_x=1.0) / "rule.json"
    with Bus({"main": ()}) as bus, open_client(bus.endpoint("main")) as client:
        command = [sys.executable, "-m", "riot_bus", "scan", "--watch", "--rule", str(rule)]
        with subprocess.Popen(
            [*command, "--endpoint", bus.endpoint("main")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "watching a for a:x > 10\n"
                assert bus.wait_subscribed("main", ["a"], timeout=60) == []
                for speed in (5.0, 9.5, 11.0):
                    client.put(Message(0, "a", json.dumps({"x": speed}).encode(), encoding="application/json"))
                warned = [process.stdout.readline().split(" ", 1)[1] for _ in range(2)]
                process.send_signal(signal.SIGINT)
                out, errors = process.communicate(timeout=60)
            finally:
                process.kill()
        assert warned == ["0.5 away: a:x = 9.5\n", "met: a:x = 11.0\n"]
        assert out == "the rule was met at 1 of 3 messages; nearest: holds, a:x = 11.0\n", errors
        assert process.returncode == 1
