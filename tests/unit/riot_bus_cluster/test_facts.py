"""What differs between two machines is told by its name and both values."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from riot_bus.trial.context import open_system
from riot_bus_cluster.facts import differences, facts_of

SYSTEM = '[components.one]\ncommand = ["{python}", "node.py"]\n[unit.one]\n'


def system_in(folder: Path, text: str = SYSTEM, code: str = "x = 1\n") -> Path:
    folder.mkdir()
    (folder / "node.py").write_text(code)
    (folder / "riot.toml").write_text(text)
    return folder / "riot.toml"


def test_the_same_system_elsewhere_is_the_same(tmp_path: Path) -> None:
    one, two = (facts_of(open_system(system_in(tmp_path / name))) for name in ("a", "b"))
    assert differences(one, two) == ""
    assert {"Python", "riot_bus", "eclipse-zenoh", "riot.toml", "code node.py"} <= one.keys()


def test_other_code_and_other_settings_are_named(tmp_path: Path) -> None:
    here = facts_of(open_system(system_in(tmp_path / "a", SYSTEM + "mined = false\n", "x = 2\n")))
    there = facts_of(open_system(system_in(tmp_path / "b")))
    told = differences(here, there).split("; ")
    assert [each.split(" is ")[0] for each in told] == ["code node.py", "riot.toml"]
    assert told[0].endswith("where riot runs")
    assert here["code node.py"][:24] in told[0]


def test_what_one_side_lacks_is_missing_there() -> None:
    mine = {f"code {n}": "1" for n in range(8)}
    assert differences({}, {"a": "1"}) == "a is missing here, 1 where riot runs"
    assert differences(mine, {}).endswith("; and 3 more")


def test_a_process_of_its_own_says_the_same_or_what_is_wrong(tmp_path: Path) -> None:
    path = system_in(tmp_path / "a")

    def told() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "riot_bus_cluster.facts", str(path)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    assert json.loads(told().stdout) == facts_of(open_system(path))
    path.write_text("[compnents.one]\n")
    wrong = told()
    assert wrong.returncode == 1
    assert "'components' is missing" in wrong.stderr
