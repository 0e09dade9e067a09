from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.testing.regression import reproduce_finding
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from tests.unit.chain.machine import Bench, bench, rated, write_minimal


def asked(one: Bench, system: Path | None = None) -> tuple[str, int]:
    file = one.workspace.context.file.path
    found = reproduce_finding(one.folder, system=system or file, trials=4, runners=one.machine)
    return found.answer, found.failed


def test_it_answers_as_reproduce_does_and_leaves_nothing(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    one.workspace.nominal_log()
    before = sorted(tmp_path.rglob("*"))
    assert asked(one) == ("still failing", 4)
    write_minimal(one, speed=5.0)
    assert asked(one) == ("fixed", 0)
    assert sorted(tmp_path.rglob("*")) == before
    assert one.machine.closed


def test_trials_that_do_not_decide_are_no_pass(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed > 0)
    write_minimal(one)
    rated(one, 8, 8)
    with pytest.raises(InconclusiveError):
        asked(one)


def test_without_a_system_file_of_the_project_it_says_so(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    (tmp_path / "riot.toml").unlink()
    with pytest.raises(ConfigError, match=r"there is no riot\.toml in .*, and no .*/riot\.toml"):
        reproduce_finding(one.folder, root=tmp_path, runners=one.machine)


@pytest.mark.parametrize("how", ["environment", "root", "working folder"])
def test_the_system_is_looked_for_where_the_error_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    moved = tmp_path / "moved" / "riot.toml"
    moved.parent.mkdir()
    (tmp_path / "riot.toml").rename(moved)
    root = moved.parent if how == "root" else Path()
    if how == "environment":
        monkeypatch.setenv("RIOT_SYSTEM", str(moved))
    if how == "working folder":
        monkeypatch.chdir(moved.parent)
    assert reproduce_finding(one.folder, root=root, trials=4, runners=one.machine).answer == "still failing"
