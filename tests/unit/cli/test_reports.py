"""`riot report` in any format, also in one of another package."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from riot_bus.campaign.store import TrialStore
from riot_bus.cli.main import make_app
from riot_bus.report.text import summary
from riot_bus.testing.reports import view_at
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.trial import Outcome, Verdict, Violation

PAGE = (Path(__file__).parents[3] / "docs" / "findings.md").read_text(encoding="utf-8")
(CSV,) = re.findall(r"^```python\n(class CsvReport.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "finding"
    found.mkdir()
    view_at("until activate", found)
    return found


def report(folder: Path, *words: str) -> Result:
    return CliRunner().invoke(make_app("report"), ["report", str(folder), *words])


def test_a_page_is_written_unless_asked_otherwise(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    assert report(folder).stdout == f"{folder / 'report.html'}\n"
    other = tmp_path / "other.html"
    assert report(folder, "-o", str(other)).stdout == f"{other}\n"
    assert other.read_bytes() == (folder / "report.html").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["finding", "other.html"]


def test_text_and_json_go_to_stdout(folder: Path, tmp_path: Path) -> None:
    before = sorted(folder.iterdir())
    assert report(folder, "--format=text").stdout == summary(folder) + "\n"
    told = json.loads(report(folder, "--format=json").stdout)
    assert (told["severity"], told["next"], told["unusable"]) == ("activated", None, {})
    assert told["steps"]["rules"]["text"] == "/map:x < 0"
    assert sorted(folder.iterdir()) == before
    file = tmp_path / "finding.txt"
    assert report(folder, "--format=text", "--out", str(file)).stdout == f"{file}\n"
    assert file.read_text() == summary(folder) + "\n"


def test_json_says_what_is_missing(tmp_path: Path) -> None:
    view_at("broken rules", tmp_path)
    told = json.loads(report(tmp_path, "--format=json").stdout)
    assert told["steps"]["rules"] is None
    assert list(told["unusable"]) == ["rule.json"]
    assert told["next"] == "rules"


def test_a_format_of_others_as_on_the_page(folder: Path, plugin_package: Callable[..., str]) -> None:
    plugin_package(CSV, "riot_bus.reports", csv="CsvReport")
    assert report(folder, "--format=csv").stdout == f"{folder / 'report.csv'}\n"
    assert (folder / "report.csv").read_text() == "id,severity\nplanner-crash-1f3a,activated\n"


def test_what_cannot_be_done_is_named(folder: Path, tmp_path: Path) -> None:
    unknown = report(folder, "--format=pdf").exception
    assert isinstance(unknown, ConfigError)
    assert "unknown report format 'pdf'" in str(unknown)
    nowhere = report(folder, "--format=text", "-o", str(tmp_path / "no" / "x")).exception
    assert isinstance(nowhere, ConfigError)
    assert "cannot write the report" in str(nowhere)


def test_trials_are_listed_and_written_as_parquet(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    store = TrialStore(tmp_path / "trials" / TrialStore.NAME)
    store.put("a", Outcome(Verdict.FAIL, (Violation("crash", "u", "crash in u"),), 0.25, "why"))
    store.put("b", Outcome(Verdict.PASS))

    def trials(*words: object) -> Result:
        return CliRunner().invoke(make_app("trials"), ["trials", *map(str, words)])

    rows = [json.loads(line) for line in trials(tmp_path).stdout.splitlines()]
    assert [(row["key"], row["verdict"], row["signatures"]) for row in rows] == [
        ("a", "fail", "crash in u"),
        ("b", "pass", ""),
    ]
    file = tmp_path / "trials.parquet"
    assert trials(tmp_path, "--out", file).stdout == f"{file}\n"
    assert parquet.read_table(file).to_pylist() == rows
    for words, why in (
        ((tmp_path, "-o", file), "exists"),
        ((tmp_path, "-o", "a.csv"), "parquet"),
        (("none",), "no trials"),
    ):
        problem = trials(*words).exception
        assert isinstance(problem, ConfigError)
        assert why in str(problem)
