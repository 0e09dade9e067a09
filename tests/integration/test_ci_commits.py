"""`riot ci` over the commits of a repository with a real unit: each regression and each fix is told rightly."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.findings.known import KnownFindings
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]

NODE = """
import json, sys, threading
import zenoh
{head}
LEVELS = [0.0, 0.5, 1.0]

def level(x):
    {level}

def share(y):
    {share}

def on_command(sample):
    try:
        command = json.loads(sample.payload.to_bytes())
        x, y = (float(command[name]) for name in "xy")
    except (KeyError, TypeError, ValueError):
        return
    out.put(json.dumps({{"level": level(x), "share": share(y)}}))

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
out = session.declare_publisher("state", congestion_control=zenoh.CongestionControl.BLOCK)
subscriber = session.declare_subscriber("command", on_command)
threading.Event().wait()
"""
SYSTEM = """
[system]
name = "press"
nominal = "nominal.mcap"

[components.press]
command = ["{python}", "node.py", "{endpoint}"]
inputs = ["command"]
outputs = ["state"]

[unit.press]
settle = { timeout = 3.0 }
"""
FAULTY, ROBUST = "return LEVELS[int(abs(x))]", "return LEVELS[int(abs(x)) if abs(x) < 3 else 2]"
UNSAFE, SAFE = "return 1 / y", "return 1 / y if y else 0.0"
OLD, NEW = f"crash in press: level: {FAULTY}", f"crash in press: share: {UNSAFE}"


class Repository:
    """A repository, whose commits are told what `riot ci` says of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.git("init", "-q")
        (folder / "riot.toml").write_text(SYSTEM)
        with LogWriter(folder / "nominal.mcap") as log:
            for number in range(20):
                payload = json.dumps({"x": number % 20 / 10, "y": 1.0 + number % 3}).encode()
                log.write(Message(10**18 + number * 10**8, "command", payload, encoding="application/json"))

    def git(self, *words: str) -> str:
        line = ["git", "-c", "user.name=x", "-c", "user.email=x@x", *words]
        return subprocess.run(line, cwd=self.folder, check=True, capture_output=True, text=True).stdout.strip()

    def commit(self, message: str, *, level: str, share: str = SAFE, head: str = "") -> str:
        """Write the node and commit it; return the begin of the commit's name."""
        (self.folder / "node.py").write_text(NODE.format(head=head, level=level, share=share))
        self.git("add", "node.py", "riot.toml", "nominal.mcap")
        self.git("commit", "-q", "-m", message)
        return self.git("rev-parse", "HEAD")[:12]

    def riot(self, *words: object) -> tuple[int, Any]:
        """Return the exit code and the result of `riot ci ...`."""
        done = CliRunner().invoke(make_app("ci"), ["ci", *map(str, words)])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        return done.exit_code, done.stdout

    def change(self) -> tuple[int, dict[str, str], list[str]]:
        """Return the exit code, the findings with what the baseline says of them, and what was learnt besides."""
        code, text = self.riot("change", "--trials", 24, "--jobs", 2, "--format", "json")
        (unit,) = json.loads(text)["units"]
        assert not unit["untested"]
        findings = {one["title"]: one["standing"] for one in unit["findings"]}
        return code, findings, [remark.partition(":")[0] for remark in unit["remarks"]]


def test_each_regression_and_each_fix_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    repository = Repository(tmp_path)

    begin = repository.commit("a fault from the beginning", level=FAULTY)
    assert repository.change() == (1, {OLD: "new"}, [])
    code, said = repository.riot("accept", "riot-out", "--note", "ticket 12", "--keep", "riot-findings")
    assert code == 0, said
    (entry,) = KnownFindings.load(tmp_path / "riot-baseline.json").entries.values()
    assert entry.since.endswith(f" {begin}")

    repository.commit("lines that shift", level=FAULTY, head="# one\n# two\n\n")
    assert repository.change() == (0, {OLD: "known"}, [])

    repository.commit("another fault", level=FAULTY, share=UNSAFE)
    assert repository.change() == (1, {OLD: "known", NEW: "new"}, [])

    shutil.rmtree(tmp_path / "riot-out")  # a build on another machine has the repository alone
    end = repository.commit("both mended", level=ROBUST)
    assert repository.change() == (0, {}, ["fixed (known)"])
    code, said = repository.riot("prune", "--update", "--jobs", 2)
    assert code == 0, said
    (entry,) = KnownFindings.load(tmp_path / "riot-baseline.json").entries.values()
    assert entry.fixed.endswith(f" {end}")
    assert entry.note == "ticket 12"

    repository.commit("nothing that matters", level=ROBUST, head="import math\n")
    assert repository.change() == (0, {}, [])

    shutil.rmtree(tmp_path / "riot-out")
    repository.commit("the first one again", level=FAULTY)
    assert repository.change() == (1, {OLD: "came back"}, [])
    code, said = repository.riot("prune", "--jobs", 2)
    assert code == 1, said
    assert f"failing again: press: {OLD} (3 of 3 fresh trials failed so)" in said
