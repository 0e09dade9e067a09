from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import RiotError
from tests.unit.riot_bus_logtools.comparison.recordings import said
from tests.unit.riot_bus_logtools.comparison.test_opening import rows, write


def diff(*words: object) -> Result:
    return CliRunner().invoke(make_app("diff"), ["diff", *map(str, words)])


def code(done: Result) -> int:
    return done.exception.exit_code if isinstance(done.exception, RiotError) else done.exit_code


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    write(tmp_path / "a.mcap", said(*rows(50, x=1.0)), said(*rows(), key="b"))
    write(tmp_path / "same.mcap", said(*rows(50, x=1.0)), said(*rows(), key="b"))
    changed = [{**row, "x": 1.5} if row["n"] == 17 else row for row in rows(50, x=1.0)]
    write(tmp_path / "changed.mcap", said(*changed), said(*rows(), key="b"))
    write(tmp_path / "other.mcap", said(*rows(), key="c"))
    return tmp_path


def test_the_same(logs: Path) -> None:
    done = diff(logs / "a.mcap", logs / "same.mcap")
    assert (code(done), done.stderr) == (0, "")
    first, *rest = done.stdout.splitlines()
    assert first == f"{logs}/a.mcap and {logs}/same.mcap are the same: 70 messages of 2 topics"
    assert rest[:2] == ["= a  50 of 50 equal", "= b  20 of 20 equal"]


def test_a_changed_field(logs: Path) -> None:
    done = diff(logs / "a.mcap", logs / "changed.mcap")
    assert code(done) == 1
    assert "    x  in 1 message, by 0.5 at most: #17 (0.017 s) 1.0 -> 1.5" in done.stdout.splitlines()
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--tolerance", "a:x=0.5")) == 0
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--tolerance", "a:x=20%")) == 1
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--topics", "b")) == 0
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--exclude", "a")) == 0
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--start", "0.018")) == 0


def test_json(logs: Path) -> None:
    document = json.loads(diff(logs / "a.mcap", logs / "changed.mcap", "--format", "json").stdout)
    assert (document["same"], document["topics"][0]["fields"][0]["example"]["a"]) == (False, 17)


def test_tolerances_are_proposed_and_taken(logs: Path) -> None:
    file = logs / "t.toml"
    done = diff("--propose", logs / "a.mcap", logs / "changed.mcap", logs / "same.mcap", "-o", file)
    assert code(done) == 0, done.output
    assert tomllib.loads(file.read_text(encoding="utf-8")) == {"tolerances": {"a:x": 3.7}}
    assert done.stdout.splitlines()[0] == "1 tolerance from 210 pairs of messages of 3 logs (3 pairs)"
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--tolerances", file)) == 0
    printed = diff("--propose", logs / "a.mcap", logs / "changed.mcap").stdout
    assert tomllib.loads(printed) == {"tolerances": {"a:x": 2.5}}
    found = json.loads(diff("--propose", logs / "a.mcap", logs / "changed.mcap", "--format", "json").stdout)
    assert found["tolerances"][0]["name"] == "a:x"


def test_nothing_could_be_compared(logs: Path) -> None:
    done = diff(logs / "a.mcap", logs / "other.mcap")
    assert code(done) == 5
    assert "nothing could be compared" in done.stdout
    write(logs / "empty.mcap")
    assert code(diff(logs / "empty.mcap", logs / "empty.mcap")) == 5
    assert code(diff("--propose", logs / "a.mcap", logs / "other.mcap")) == 5


def test_the_same_as_far_as_a_damaged_log_can_be_read(logs: Path) -> None:
    damaged = logs / "damaged.mcap"
    damaged.write_bytes((logs / "a.mcap").read_bytes()[:-50])
    done = diff(logs / "a.mcap", damaged)
    assert code(done) == 3
    assert "missing: " in done.stdout


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["a.mcap"], "two logs are compared, not 1"),
        (["a.mcap", "same.mcap", "changed.mcap"], "two logs are compared, not 3"),
        (["a.mcap", "none.mcap"], "cannot read the log"),
        (["a.mcap", "same.mcap", "--tolerance", "x"], "says no tolerance"),
        (["a.mcap", "same.mcap", "--tolerances", "none.toml"], "cannot read the tolerances"),
        (["a.mcap", "same.mcap", "--topics", "z"], "no log has a topic"),
        (["a.mcap", "same.mcap", "-o", "x.toml"], "--out cannot be used without --propose"),
        (["--propose", "a.mcap"], "two runs or more"),
        (["--propose", "a.mcap", "same.mcap", "--timing", "1"], "--timing cannot be used with --propose"),
    ],
)
def test_wrong_use(logs: Path, words: list[str], problem: str) -> None:
    done = diff(*(logs / word if word.endswith(".mcap") else word for word in words))
    assert code(done) == 2
    assert problem in str(done.exception)


def test_a_page(logs: Path) -> None:
    page = logs / "diff.html"
    assert code(diff(logs / "a.mcap", logs / "changed.mcap", "--html", page)) == 1
    assert "<h2><code>a</code></h2>" in page.read_text(encoding="utf-8")


def test_names_in_logs_do_nothing_to_a_terminal(tmp_path: Path) -> None:
    a = write(tmp_path / "a.mcap", said({"x\x1b[31m": "\x1b[31m"}, key="t\x1b[31m"))
    b = write(tmp_path / "b.mcap", said({"x\x1b[31m": "\x1b[32m"}, key="t\x1b[31m"))
    done = diff(a, b)
    assert (code(done), "\x1b" in done.output) == (1, False)
