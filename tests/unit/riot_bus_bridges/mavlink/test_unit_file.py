"""The systemd unit names what `riot bridge mavlink` knows, and systemd takes it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions

UNIT = Path(__file__).resolve().parents[4] / "deploy" / "riot-bridge-mavlink@.service"


def test_its_options_and_links_are_good():
    text = UNIT.read_text()
    told = (
        CliRunner().invoke(make_app(), ["bridge", "mavlink", "--help"], env={"COLUMNS": "200", "NO_COLOR": "1"}).output
    )
    options = set(re.findall(r"--[a-z][a-z-]+", text)) - {"--now"}
    assert options == {"--segment", "--link"}
    assert [each for each in options if each not in told] == []
    links = re.findall(r"--link=([^ \"\n]+)", text)
    segments = re.findall(r"--segment=(\w+)=", text)
    assert [each.where for each in MavlinkBridgeOptions(links).plan(segments).links] == [
        "/dev/ttyACM0:115200",
        "0.0.0.0:14550",
    ]
    assert "ExecStart=/opt/riot/bin/riot bridge mavlink " in text


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_it(tmp_path):
    unit = tmp_path / UNIT.name.replace("@", "@drone")
    text = UNIT.read_text().replace("/opt/riot/bin/riot", "/bin/true").replace("User=riot", "User=root")
    unit.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, str(unit) in done.stderr) == (0, False), done.stderr
