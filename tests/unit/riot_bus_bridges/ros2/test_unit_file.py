"""The systemd unit names what `riot bridge ros2` knows, and systemd takes it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app

UNIT = Path(__file__).resolve().parents[4] / "deploy" / "riot-bridge-ros2@.service"


def test_its_variables_and_options_exist():
    text = UNIT.read_text()
    told = CliRunner().invoke(make_app(), ["bridge", "ros2", "--help"], env={"COLUMNS": "200", "NO_COLOR": "1"}).output
    assert set(re.findall(r"\bRIOT_\w+", text)) == {"RIOT_CLIENT_CFG", "RIOT_ROS_SETUP"}
    options = set(re.findall(r"--[a-z][a-z-]+", text)) - {"--now"}
    assert options == {"--domain", "--endpoint"}
    assert [each for each in {"RIOT_ROS_SETUP", *options} if each not in told] == []
    assert "ExecStart=/opt/riot/bin/riot bridge ros2 " in text


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_it(tmp_path):
    unit = tmp_path / UNIT.name.replace("@", "@7")
    text = UNIT.read_text().replace("/opt/riot/bin/riot", "/bin/true").replace("User=ros", "User=root")
    unit.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, str(unit) in done.stderr) == (0, False), done.stderr
