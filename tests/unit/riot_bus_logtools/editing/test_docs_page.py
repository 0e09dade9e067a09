"""Every command of docs/edit.md is carried out."""

import json
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.log.reader import read_log
from riot_bus.log.rosbag2 import files_of
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.message import Message

PAGE = Path(__file__).parents[4] / "docs" / "edit.md"
COMMANDS = [
    shlex.split(line.strip(), comments=True)
    for line in PAGE.read_text().splitlines()
    if line.startswith("    riot edit ")
]
BODY = {
    "twist": {"twist": {"linear": {"x": 1.0}}},
    "pose": {"pose": {"position": {"x": 4.0}}, "covariance": [0.25]},
    "ranges": [1.0, 2.0],
    "stamp": {"sec": 5, "nanosec": 6},
}
TOPICS = ("/odom", "/scan", "/tf", "/camera", "/imu")
OUTPUTS = ("out.mcap", "both.mcap", "whole.mcap", "cut")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    for name in ("in", "monday", "tuesday", "broken", "run/run_0"):
        with LogWriter(tmp_path / f"{name}.mcap") as writer:
            for n in range(200):
                payload = json.dumps({"n": n, **BODY}).encode()
                writer.write(Message(n * 10**8, TOPICS[n % 5], payload, encoding="application/json"))
    (tmp_path / "plan.toml").write_text('[[inject]]\ntopic = "/odom"\nfield = "n"\nvalue = 5\n')
    return tmp_path


def test_there_are_commands():
    assert len(COMMANDS) > 10


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_command_works(folder, command):
    result = CliRunner().invoke(make_app(), command[1:])
    assert not isinstance(result.exception, RiotError), result.exception
    assert result.exit_code == 0, result.output
    words = [word for word in command if not word.startswith("-")]
    outputs = [file for word in words for file in files_of(Path(word)) if word in OUTPUTS and file.exists()]
    assert outputs
    assert all(read_log(path) for path in outputs)
