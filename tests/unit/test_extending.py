"""docs/extending.md: each example is installed as a package and passes the tests that are printed with it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.inject.dictionary import load_dictionary
from tests.plugin_kinds import KINDS

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## ([^\n]*)\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL))
EXAMPLES = {
    name: blocks
    for name, text in SECTIONS.items()
    if len(blocks := re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)) == 2
}
POINT = re.compile(r'\[(riot_bus\.\w+)\] (\w+ = )"(.*)"')


def test_each_kind_of_plug_in_has_a_place_on_the_page() -> None:
    groups = {kind.group for kind in KINDS}
    assert groups == set(re.findall(r"`(riot_bus\.\w+)`", PAGE)) & groups
    assert len(EXAMPLES) == 8


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_works_as_printed(name: str, tmp_path: Path) -> None:
    code, tests = EXAMPLES[name]
    assert len(code.splitlines()) <= 40
    found = POINT.search(code)
    assert found is not None
    info = tmp_path / "my_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{found[1]}]\n{found[2]}{found[3]}\n")
    (tmp_path / "my_package.py").write_text(code)
    (tmp_path / "test_my_package.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_my_package.py"]
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert " passed" in done.stdout


def test_the_dictionary_on_the_page_loads(tmp_path: Path) -> None:
    (text,) = re.findall(r"^```toml\n(.*?)^```$", SECTIONS["Mutation"], re.MULTILINE | re.DOTALL)
    (tmp_path / "mine.toml").write_text(text)
    dictionary = load_dictionary([tmp_path / "mine.toml"])
    assert next(each.value for each in dictionary.values_for("uint8", "a:b.mode")) == 255
    assert "two rows more than there is data" in {
        each.reason for each in dictionary.mutations_for("sensor_msgs/msg/Image")
    }
