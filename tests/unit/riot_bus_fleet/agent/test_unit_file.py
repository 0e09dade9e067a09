"""The systemd unit names what `riot agent` knows, and systemd takes it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app

UNIT = Path(__file__).resolve().parents[4] / "deploy" / "riot-agent.service"


def test_its_variables_and_options_exist() -> None:
    text = UNIT.read_text()
    told = CliRunner().invoke(make_app(), ["agent", "--help"], env={"COLUMNS": "200", "NO_COLOR": "1"}).output
    variables = set(re.findall(r"\bRIOT_\w+", text))
    others = {"RIOT_ROBOT", "RIOT_ENDPOINT", "RIOT_AGENT_LOGS", "RIOT_AGENT_CATALOGUE"}
    assert variables == others | {"RIOT_FLEET", "RIOT_FLEET_CFG"}
    options = set(re.findall(r"--[a-z][a-z-]+", text)) - {"--now"}
    assert [each for each in variables | options if each not in told] == []
    assert "ExecStart=/opt/riot/bin/riot agent " in text


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_it(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/riot/bin/riot", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, str(unit) in done.stderr) == (0, False), done.stderr
