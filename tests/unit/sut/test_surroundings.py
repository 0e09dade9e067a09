from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from riot_bus.sut.launcher import Launcher
from riot_bus.sut.surroundings import FIXED, fixed_environment, fixes_addresses

CODE = "import ctypes; print(ctypes.addressof(ctypes.c_int.in_dll(ctypes.pythonapi, 'Py_OptimizeFlag')))"


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
