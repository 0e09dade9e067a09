from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from riot_bus import plugins
from riot_bus.cli.main import COMMANDS, add_commands, make_app
from riot_bus.findings.records import FindingRecord
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_testkit.reports import campaign_at


@pytest.mark.parametrize("module", COMMANDS)
def test_each_module_has_the_commands_by_which_it_is_found(module: str) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    add_commands(app, module)
    assert tuple(typer.main.get_group(app).commands) == COMMANDS[module]


def test_one_command_needs_its_module_alone() -> None:
    everything = typer.main.get_group(make_app()).commands
    ours = {name for commands in COMMANDS.values() for name in commands}
    assert sorted(everything) == sorted(ours | {name.partition(".")[0] for name in plugins.COMMANDS.targets()})
    assert list(typer.main.get_group(make_app("info")).commands) == ["info", "types", "show"]
    assert list(typer.main.get_group(make_app("--version")).commands) == list(everything)


def test_what_is_logged_shows_no_secret_and_no_control_character() -> None:
    code = """
import logging, sys
from riot_bus.cli import main
sys.argv = ["riot", "info", "--help"]
try:
    main.run()
except SystemExit:
    pass
try:
    raise ValueError("tls/host:1#key=s3kR1t")
except ValueError:
    logging.getLogger("riot_bus.any").exception("no link to %s \\x1b[2J\\x9b", "tls/host:1#key=s3kR1t")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert "no link to tls/host:1#... \\x1b[2J\\x9b\n" in done.stderr, "what a finding names cannot move a cursor"
    assert "\x1b" not in done.stderr
    assert "ValueError: tls/host:1#..." in done.stderr
    assert "s3kR1t" not in done.stderr


def test_a_wrong_command_is_answered_as_if_all_were_known() -> None:
    result = CliRunner().invoke(make_app("recrod"), ["recrod"])
    assert result.exit_code == 2
    assert "No such command 'recrod'" in result.output


@pytest.mark.parametrize(
    "words",
    [
        ["info", "--fields"],
        ["types"],
        ["types", "--topics", "reed"],
        ["export", "--field", "reed:x", "-o", "a.csv"],
        ["export", "--field", "**:x", "-o", "a.csv"],
        ["edit", "b.mcap"],
        ["edit", "b.mcap", "--keep", "reed"],
        ["edit", "b.mcap", "--set", "reed:x=5"],
    ],
)
def test_no_name_in_a_log_commands_a_terminal(words: list[str], tmp_path: Path) -> None:
    with LogWriter(tmp_path / "a.mcap", metadata={"robot": "\x1b[2J"}) as writer:
        writer.write(Message(10**18, "red\x1b[31m\x07", b'{"x\\u001b": 1, "x": 2}', encoding="application/json"))
    command = [sys.executable, "-m", "riot_bus", words[0], "a.mcap", *words[1:]]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert "\x1b" not in said
    assert "\x07" not in said
    table = tmp_path / "a.csv"
    assert "\\x1b" in said + (table.read_text() if table.exists() else "")


@pytest.mark.parametrize(
    "words",
    [
        ["findings", "."],
        ["findings", ".", "--format=json"],
        ["report", ".", "--format=markdown"],
        ["report", "findings/one", "--format=text"],
        ["report", "findings/one", "--format=github"],
        ["ci", "accept", "."],
        ["info", "::stop-commands::tok ##[add-mask]riot.mcap"],
        ["findings", "##vso[task.setvariable variable=PATH]x"],
    ],
    ids=" ".join,
)
def test_no_text_of_a_finding_commands_what_runs_the_build(words: list[str], tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    (folder,) = (tmp_path / "findings").iterdir()
    record = FindingRecord.load(folder).model_copy(
        update={"id": "::stop-commands::tok", "signature": "x ##[add-mask]r"}
    )
    folder = folder.rename(folder.with_name("one"))
    record.save(folder)
    env = {**os.environ, "GITHUB_ACTIONS": "true", "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "riot_bus", *words]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, check=False)
    lines = (done.stdout + done.stderr).decode().splitlines()
    commands = [line for line in lines if line.lstrip().startswith("::") or re.search(r"##\w*\[", line)]
    assert lines
    assert len(commands) == (2 if "--format=github" in words else 0)
    assert all(re.match(r"::(error|warning|notice) ", line) for line in commands)
    if "--format=json" in words:
        assert json.loads(done.stdout)[0]["signature"] == "x ##[add-mask]r"
    if "--format=text" in words:
        with (tmp_path / "kept").open("wb") as file:  # a file is no output of the build
            subprocess.run(command, cwd=tmp_path, env=env, stdout=file, check=False)
        assert (tmp_path / "kept").read_text().startswith("::stop-commands::tok")
