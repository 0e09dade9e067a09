"""`riot guard`: what it prints goes into riot.toml as it is."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from tests.unit.chain.machine import bench, write_minimal, write_rule


def test_its_output_is_a_piece_of_riot_toml(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    write_rule(one)
    done = CliRunner().invoke(make_app("guard"), ["guard", str(tmp_path / "out"), "--action", "hold"])
    assert done.exit_code == 0, done.output
    (table,) = tomllib.loads(done.stdout)["router"]["interceptors"]
    assert table["action"] == "hold"
    assert "# minimal.mcap: the rule holds for 1 of 1 message: 1 dropped" in done.stdout
    told = CliRunner().invoke(make_app("guard"), ["guard", str(one.folder), "--format", "json"])
    assert json.loads(told.stdout)["trials"][0]["done"] == {"dropped": 1}


def test_another_action_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(make_app("guard"), ["guard", str(tmp_path), "--action", "explode"])
    assert done.exit_code == 2
