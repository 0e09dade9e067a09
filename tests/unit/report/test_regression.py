from __future__ import annotations

import ast
import os
import subprocess
from pathlib import Path

import pytest

from riot_bus.findings.records import FindingRecord
from riot_bus.report.regression import regression_name, write_regression_test, write_reproduce


def finding(**more: object) -> FindingRecord:
    known = {
        "id": "crash-planner-1f3a", "system": "rover", "system_file": "/site/rover/riot.toml", "unit": "planner",
        "component": "planner", "monitor": "crash", "signature": "crash in planner: window: raise ValueError",
    }  # fmt: skip
    return FindingRecord.model_validate(known | more)


def test_the_file_is_a_test_that_pytest_does_not_collect_by_itself(tmp_path: Path) -> None:
    folder = tmp_path / "riot-out/findings/crash-planner-1f3a"
    folder.mkdir(parents=True)
    path = write_regression_test(folder, finding(system_file=str(tmp_path / "riot.toml")))
    assert path == folder / "riot_test_crash_planner_1f3a.py"
    text = path.read_text()
    names = [each.name for each in ast.parse(text).body if isinstance(each, ast.FunctionDef)]
    assert names == ["test_crash_planner_1f3a"]
    assert "riot.toml of the working folder" in text
    assert str(tmp_path) not in text
    assert [each.name for each in folder.iterdir()] == [path.name]


HOSTILE = '"""\nimport os\nos.system("x")\n\\N{BULLET} {0} \u202e'


def test_names_of_others_stay_text(tmp_path: Path) -> None:
    record = finding(id=HOSTILE, component=HOSTILE, monitor=HOSTILE, signature=HOSTILE, system_file=f"/a/{HOSTILE}/b")
    path = write_regression_test(tmp_path, record)
    assert path.parent == tmp_path
    tree = ast.parse(path.read_text())
    kinds = [type(each).__name__ for each in tree.body]
    assert kinds == [
        type(each).__name__ for each in ast.parse(write_regression_test(tmp_path, finding()).read_text()).body
    ]
    values = {
        ast.literal_eval(each.value)
        for each in ast.walk(tree)
        if isinstance(each, ast.Assign) and isinstance(each.value, ast.Constant)
    }
    assert HOSTILE in values


def test_a_name_of_nothing_but_signs() -> None:
    assert regression_name(finding(id="../..")) == "riot_test_finding.py"


@pytest.fixture
def recorder(tmp_path: Path) -> dict[str, str]:
    """Put a `riot` on the path that tells its arguments, one per line."""
    room = tmp_path / "bin"
    room.mkdir()
    riot = room / "riot"
    riot.write_text("#!/bin/sh\nprintf '<%s>' \"$@\"\nexit 1\n")
    riot.chmod(0o755)
    return os.environ | {"PATH": f"{room}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.parametrize("name", ["plain", "with space", "quote's $(touch x) `y`", "-dash", "a;b&c"])
def test_runs_where_it_lies(tmp_path: Path, recorder: dict[str, str], name: str) -> None:
    directory = tmp_path / name
    directory.mkdir()
    script = write_reproduce(directory)
    for cwd, command in ((tmp_path, script), (directory, "./reproduce.sh")):
        done = subprocess.run(
            [command, "--format", "json"], cwd=cwd, env=recorder, capture_output=True, text=True, check=False
        )
        assert done.stdout == f"<reproduce><{directory}><--format><json>"
        assert done.returncode == 1


def test_the_script_is_written_whole(tmp_path: Path) -> None:
    script = write_reproduce(tmp_path)
    assert script == tmp_path / "reproduce.sh"
    assert os.access(script, os.X_OK)
    lines = script.read_text().splitlines()
    assert len(lines) == 2
    assert lines[0] == "#!/bin/sh"
    assert write_reproduce(tmp_path).read_text().splitlines() == lines
    assert [path.name for path in tmp_path.iterdir()] == ["reproduce.sh"]
