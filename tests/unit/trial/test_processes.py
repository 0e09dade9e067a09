"""What becomes of a setup; all else of starting: tests/integration/test_trial_processes.py."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from riot_bus.processes.launcher import Launcher
from riot_bus.trial.context import open_system
from riot_bus.trial.processes import FIXED, TrialProcesses, fixed_environment, fixes_addresses
from riot_bus.vocabulary.errors import RiotError

CODE = "import ctypes; print(ctypes.addressof(ctypes.c_int.in_dll(ctypes.pythonapi, 'Py_OptimizeFlag')))"


@pytest.mark.parametrize(
    ("setup", "command"), [("false", "true"), ("no-such-program", "true"), ("true", "no-such-program")]
)
def test_what_was_set_up_is_torn_down_where_nothing_starts(tmp_path: Path, setup: str, command: str) -> None:
    path = tmp_path / "riot.toml"
    path.write_text(
        f"[components.part]\ncommand = [{command!r}]\nsetup = [{setup!r}]\nteardown = ['touch', '{tmp_path}/torn']\n"
    )
    with Launcher() as launcher:
        processes = TrialProcesses(open_system(path), launcher, tmp_path)
        with pytest.raises(RiotError):
            processes.start("part", "tcp/127.0.0.1:1", segment="system", seed=0)
    assert (tmp_path / "torn").exists() is (setup != "no-such-program")


def test_what_riot_toml_sets_itself_stays() -> None:
    assert fixed_environment({}) == FIXED
    assert fixed_environment({"TZ": "CET", "OTHER": "1"}) == {k: v for k, v in FIXED.items() if k != "TZ"}


@pytest.mark.parametrize("fixed", [True, False])
def test_addresses_are_the_same_each_time(tmp_path: Path, *, fixed: bool) -> None:
    seen = set()
    with Launcher() as launcher:
        for number in range(4):
            folder = tmp_path / str(number)
            folder.mkdir()
            process = launcher.start(
                "part", [sys.executable, "-c", CODE], env=dict(os.environ), cwd=tmp_path, directory=folder, fixed=fixed
            )
            assert launcher.wait([process], timeout=30)
            seen.add(process.printed())
    assert len(seen) == (1 if fixed and fixes_addresses() else 4)
