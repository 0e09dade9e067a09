"""The table of steps, and a step that another package brings."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from inspect import signature
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus import plugins
from riot_bus.chain.steps.analyze import analyze
from riot_bus.cli.main import make_app
from riot_bus.findings.steps import STEPS, ChainStep, find_step, further_steps
from riot_bus.report import finding_view as view
from riot_bus.report.page import write_report
from riot_bus.report.text import summary
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.chain.machine import SYSTEM, Bench, bench, write_minimal

SOURCE = '''
"""A step: how many bytes does the failure need?"""

from pathlib import Path

from riot_bus.chain.base.logs import read_messages
from riot_bus.chain.base.workspace import StepRun
from riot_bus.findings.records import Artefact
from riot_bus.findings.steps import ChainStep, StepOption


class SizeRecord(Artefact):
    FILE = "size.json"
    STEP = "step size"
    bytes: int

    @property
    def summary(self) -> str:
        return f"the failure needs {self.bytes} bytes <b>"


def measure(step: StepRun, folder: Path, *, extra: int = 0, log: str = "minimal") -> SizeRecord:
    messages = read_messages(folder / f"{log}.mcap", registry=step.workspace.context.registry)
    return SizeRecord(bytes=extra + sum(len(message.payload) for message in messages))


SIZE = ChainStep(
    "size",
    "size of the minimal log",
    "Say how many bytes the failure needs.",
    SizeRecord,
    measure,
    (StepOption("extra", 0, "Bytes to add.", min=0), StepOption("log", "minimal", "Which log.")),
)
ODD = "no step"
THIEF = SIZE._replace(name="thief", record="riot_bus.findings.records:RuleRecord")
'''
POINTS = "[riot_bus.steps]\nsize = riot_size:SIZE\n"


@pytest.fixture
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Another package that brings a step; returns the file of its entry points."""
    place = tmp_path_factory.mktemp("site")
    (place / "riot_size.py").write_text(SOURCE)
    info = place / "riot_size-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: riot-size\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(place)
    plugins._installed.cache_clear()
    yield info / "entry_points.txt"
    sys.modules.pop("riot_size", None)
    plugins._installed.cache_clear()


@pytest.fixture
def one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A finding with a minimal log, in the working folder."""
    monkeypatch.chdir(tmp_path)
    made = bench(tmp_path, SYSTEM[: SYSTEM.index("[external]")] + "[unit.drive]\n")
    write_minimal(made)
    return made


def test_records_and_functions_are_there_and_take_the_options() -> None:
    assert len({step.name for step in STEPS}) == len({step.kind.FILE for step in STEPS}) == len(STEPS)
    for step in STEPS:
        assert step.name == step.kind.STEP
        assert step.help.endswith(".")
    for step in STEPS[1:]:
        parameters = signature(step.function).parameters
        assert {option.name: option.default for option in step.options}.items() <= {
            name: parameter.default for name, parameter in parameters.items()
        }.items()


def test_ours_are_registered_like_any_other() -> None:
    for step in STEPS:
        assert find_step(step.name) is step


def test_the_table_costs_nothing_to_import() -> None:
    code = "import sys, riot_bus.findings.steps; print(len({'pydantic', 'numpy', 'dataclasses'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "0\n"


def test_a_step_of_another_package_runs_after_ours_and_is_in_the_report(installed: Path, one: Bench) -> None:
    assert further_steps() == ["size"]
    assert view.load(one.folder).further == ()
    assert "size" not in summary(one.folder)
    analyze(one.workspace, one.folder, further=[find_step("size")])
    (found,) = view.load(one.folder).further
    assert found[0].name == "size"
    told = view.load(one.folder)
    assert told.next_step == "permeability"  # not ours alone
    page = write_report(one.folder).read_text()
    assert "<h2>size of the minimal log</h2>" in page
    assert "bytes &lt;b&gt;</p>" in page
    assert "  size      the failure needs 48 bytes" in summary(one.folder)


def test_it_is_a_command(installed: Path, one: Bench) -> None:
    app = make_app("step")
    done = CliRunner().invoke(app, ["step", "size", str(one.folder), "--extra=1000", "--format=json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["bytes"] == 1048
    assert "1048 bytes" in done.stderr
    listed = CliRunner().invoke(app, ["step", "--help"])
    assert "Say how many bytes the failure needs." in listed.stdout
    told = CliRunner().invoke(app, ["step", "size", "--help"])
    assert "Bytes to add." in told.stdout
    assert CliRunner().invoke(app, ["step", "sice"]).exit_code == 2


def test_events_are_lines_on_stdout(installed: Path, one: Bench) -> None:
    done = CliRunner().invoke(make_app("step"), ["step", "size", str(one.folder), "--format=ndjson"])
    assert done.exit_code == 0, done.output
    started, finished, result = map(json.loads, done.stdout.splitlines())
    assert started == {"event": "StepStarted", "step": "size"}
    assert (finished["event"], finished["step"], finished["folder"]) == ("StepFinished", "size", str(one.folder))
    assert finished["record"]["bytes"] == result["bytes"] == 48
    assert result["event"] == "Result"


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("size = riot_size:ODD", "step 'size' is 'no step'"),
        ("other = riot_size:SIZE", "step 'other' is ChainStep"),
        ("thief = riot_size:THIEF", "step 'thief' writes rule.json, not a thief.json of its own"),
        ("size = riot_size:NONE", "step 'size' cannot be loaded"),
        ("size = riot_none:SIZE", "step 'size' cannot be loaded"),
    ],
)
def test_a_step_that_cannot_be_used_is_told_and_spoils_no_report(
    installed: Path, one: Bench, points: str, message: str
) -> None:
    installed.write_text(f"[riot_bus.steps]\n{points}\n")
    plugins._installed.cache_clear()
    (name,) = further_steps()
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        find_step(name)
    assert f"step {name}" not in view.load(one.folder).broken, "nothing of it is there, so it is not loaded"
    (one.folder / f"{name}.json").write_text("{}")
    assert f"step {name}" in view.load(one.folder).broken
    assert "cannot be used" in write_report(one.folder).read_text()


def test_another_package_cannot_take_our_names(installed: Path) -> None:
    installed.write_text("[riot_bus.steps]\nrules = riot_size:SIZE\n")
    plugins._installed.cache_clear()
    assert find_step("rules") in STEPS
    assert further_steps() == []


def test_an_unknown_step_is_told_with_what_is_near() -> None:
    with pytest.raises(ConfigError, match=r"unknown step 'minimise'[^?]*'minimize'\?"):
        find_step("minimise")


def test_a_step_is_plain_data() -> None:
    step = ChainStep("x", "X", "Do x.", "riot_bus.findings.records:RuleRecord")
    assert (step.run, step.options, step.whole_system) == (None, (), False)
