from __future__ import annotations

import ast
from pathlib import Path

from riot_bus.findings.records import FindingRecord
from riot_bus.report.regression import regression_name, write_regression_test


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
    assert "'../../../riot.toml'" in text
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
