"""What users get wrong gets a clear error with the place and a suggestion, the right exit code, and no traceback."""

from __future__ import annotations

import json
import shutil
import socket
from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

pytestmark = pytest.mark.integration

PRESS = Path(__file__).resolve().parents[1] / "systems" / "press"


@pytest.fixture
def press(tmp_path: Path) -> Path:
    """A copy of the press that a test may break."""
    shutil.copytree(PRESS, tmp_path / "press", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "press" / "riot.toml"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def check(done, code: int, *words: str) -> None:
    assert done.returncode == code, (done.returncode, done.stderr)
    assert "Traceback (most recent call last)" not in done.stderr.replace("its last words", "") or code == 4
    assert done.stderr.startswith("riot: ") or "\nriot: " in done.stderr
    for word in words:
        assert word in done.stderr, done.stderr


def test_unknown_key(riot, press: Path, tmp_path: Path) -> None:
    edit(press, "segments = ", "segmnets = ")
    check(riot("test", "--system", press, "--out", tmp_path / "out"), 2, "riot.toml:", "'segmnets'", "'segments'")


def test_component_that_does_not_exist(riot, press: Path, tmp_path: Path) -> None:
    edit(press, '["{python}", "drive.py", "{endpoint}"]', '["no-such-program"]')
    check(riot("test", "--system", press, "--out", tmp_path / "out"), 4, "'drive'", "no-such-program", "riot.toml")


def test_component_that_dies_at_start(riot, press: Path, tmp_path: Path) -> None:
    edit(press.parent / "drive.py", "def main():", "def main():\n    raise SystemExit('no drive connected')")
    check(riot("test", "--system", press, "--out", tmp_path / "out"), 4, "'drive'", "no drive connected")


def test_component_that_never_subscribes(riot, press: Path, tmp_path: Path) -> None:
    edit(press.parent / "drive.py", '"press/drive/command"', '"press/drive/comand"')
    nominal(press, [b'{"seq": 1, "mode": "step", "speed": 2.0}'])
    edit(press, "[unit.drive]", "[components.drive.ready]\ntimeout = 1.0\n\n[unit.drive]")
    check(riot("test", "--system", press, "--out", tmp_path / "out"), 4, "'drive'", "press/drive/command", "1 s")


def nominal(press: Path, payloads: list[bytes]) -> Path:
    log = press.parent / "nominal.mcap"
    with LogWriter(log) as writer:
        for number, payload in enumerate(payloads):
            writer.write(Message(10**18 + number * 10**7, "press/drive/command", payload))
    edit(press, 'name = "press"', 'name = "press"\nnominal = "nominal.mcap"')
    return log


def test_truncated_log_is_read_as_far_as_it_goes_and_info_says_so(riot, press: Path, tmp_path: Path) -> None:
    payload = json.dumps({"seq": 1, "mode": "step", "speed": 2.0}).encode()
    log = nominal(press, [payload] * 300)
    log.write_bytes(log.read_bytes()[:-400])
    check(riot("info", log), 3, "nominal.mcap")
    done = riot("test", "--system", press, "--out", tmp_path / "out", "--trials", 1)
    assert done.returncode in (0, 1), done.stderr
    assert "nominal.mcap is damaged" in done.stderr


def test_log_that_is_no_mcap(riot, press: Path, tmp_path: Path) -> None:
    log = nominal(press, [b"{}"])
    log.write_bytes(b"this is not a log")
    check(riot("test", "--system", press, "--out", tmp_path / "out"), 2, "nominal.mcap")


def test_payloads_that_do_not_decode(riot, press: Path, tmp_path: Path) -> None:
    nominal(press, [b"\xff\x00 not json"] * 3)
    done = riot("test", "--system", press, "--out", tmp_path / "out")
    check(done, 2, "no field that can be injected", "hint")


def test_dictionary_with_a_field_that_is_not_there(riot, press: Path, tmp_path: Path) -> None:
    nominal(press, [json.dumps({"seq": 1, "mode": "step", "speed": 2.0}).encode()] * 30)
    (press.parent / "limits.toml").write_text(
        '[[field]]\npath = "sped"\nentries = [{ value = 9.5, reason = "fast" }]\n'
    )
    edit(press, "[unit.drive]", '[unit.drive]\ndictionaries = ["limits.toml"]')
    done = riot("test", "--system", press, "--out", tmp_path / "out", "--trials", 1)
    check(done, 2, "limits.toml: field[0]", "no field of the log is called 'sped'", "'speed'")


def test_port_in_use(riot) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        check(riot("router", "--segment", f"system={endpoint}"), 4, endpoint)


def test_finding_that_is_not_there(riot, tmp_path: Path) -> None:
    check(riot("minimize", tmp_path / "nowhere"), 2, "nowhere", "riot test")
