"""What becomes of a setup; all else of starting: tests/integration/test_sut_starter.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.sut.context import open_system
from riot_bus.sut.launcher import Launcher
from riot_bus.sut.python_report import PythonReport
from riot_bus.sut.starter import ComponentStarter
from riot_bus.vocabulary.errors import RiotError


@pytest.mark.parametrize(
    ("setup", "command"), [("false", "true"), ("no-such-program", "true"), ("true", "no-such-program")]
)
def test_what_was_set_up_is_torn_down_where_nothing_starts(tmp_path: Path, setup: str, command: str) -> None:
    path = tmp_path / "riot.toml"
    path.write_text(
        f"[components.part]\ncommand = [{command!r}]\nsetup = [{setup!r}]\nteardown = ['touch', '{tmp_path}/torn']\n"
    )
    with Launcher() as launcher:
        starter = ComponentStarter(
            open_system(path), launcher, tmp_path, python=PythonReport(tmp_path), imports={}, parameters={}
        )
        with pytest.raises(RiotError):
            starter.start("part", "tcp/127.0.0.1:1", segment="system", seed=0, pace=None, before=())
    assert (tmp_path / "torn").exists() is (setup != "no-such-program")
