"""`riot ci` over the commits of a repository with a real unit: each regression and each fix is told rightly."""

from __future__ import annotations

import json
import re
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

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```\w+\n# (drive\.py|riot\.toml)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
FILES = dict(BLOCKS)
"""A drive with a fault, and its system, as on the page."""

FAULTY = "return TORQUES[int(abs(speed))]"
ROBUST = "return TORQUES[int(abs(speed)) if abs(speed) < 4 else 3]"
ANSWER = '{"torque": torque(speed)}'
UNSAFE = '{"root": math.sqrt(speed + 100), "torque": torque(speed)}'
OLD = f"crash in drive: torque: {FAULTY}"
NEW = f"crash in drive: on_command: state.put(json.dumps({UNSAFE}))"


class Repository:
    """A repository, whose commits are told what `riot ci` says of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.git("init", "-q")
        named = FILES["riot.toml"].replace("[system]\n", '[system]\nnominal = "nominal.mcap"\n')
        (folder / "riot.toml").write_text(named)
        with LogWriter(folder / "nominal.mcap") as log:
            for number in range(20):
                payload = json.dumps({"speed": number / 10}).encode()
                log.write(Message(10**18 + number * 10**8, "command", payload, encoding="application/json"))

    def git(self, *words: str) -> str:
        line = ["git", "-c", "user.name=x", "-c", "user.email=x@x", *words]
        return subprocess.run(line, cwd=self.folder, check=True, capture_output=True, text=True).stdout.strip()

    def commit(self, message: str, *, torque: str, answer: str = ANSWER, head: str = "") -> str:
        """Write the drive and commit it; return the begin of the commit's name."""
        source = f"import math\n{head}{FILES['drive.py']}".replace(FAULTY, torque).replace(ANSWER, answer)
        (self.folder / "drive.py").write_text(source)
        self.git("add", "drive.py", "riot.toml", "nominal.mcap")
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

    assert FAULTY in FILES["drive.py"]
    assert ANSWER in FILES["drive.py"]
    begin = repository.commit("a fault from the beginning", torque=FAULTY)
    assert repository.change() == (1, {OLD: "new"}, [])
    code, said = repository.riot("accept", "riot-out", "--note", "ticket 12", "--keep", "riot-findings")
    assert code == 0, said
    (entry,) = KnownFindings.load(tmp_path / "riot-baseline.json").entries.values()
    assert entry.since.endswith(f" {begin}")

    repository.commit("lines that shift", torque=FAULTY, head="# one\n# two\n\n")
    assert repository.change() == (0, {OLD: "known"}, [])

    repository.commit("another fault", torque=FAULTY, answer=UNSAFE)
    assert repository.change() == (1, {OLD: "known", NEW: "new"}, [])

    shutil.rmtree(tmp_path / "riot-out")  # a build on another machine has the repository alone
    end = repository.commit("both mended", torque=ROBUST)
    assert repository.change() == (0, {}, ["fixed (known)"])
    code, said = repository.riot("prune", "--update", "--jobs", 2)
    assert code == 0, said
    (entry,) = KnownFindings.load(tmp_path / "riot-baseline.json").entries.values()
    assert entry.fixed.endswith(f" {end}")
    assert entry.note == "ticket 12"

    repository.commit("nothing that matters", torque=ROBUST, head="\n")
    assert repository.change() == (0, {}, [])

    shutil.rmtree(tmp_path / "riot-out")
    repository.commit("the first one again", torque=FAULTY)
    assert repository.change() == (1, {OLD: "came back"}, [])
    code, said = repository.riot("prune", "--jobs", 2)
    assert code == 1, said
    assert f"failing again: drive: {OLD} (3 of 3 fresh trials failed so)" in said
