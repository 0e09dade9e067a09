"""What the page for users says is true."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.catalogue import _CONDITIONS, interceptor_list
from riot_bus.interceptors.parsing import from_tables, from_text

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "interceptors.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    (riot router .*)$", PAGE, re.MULTILINE)


def block(language):
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with the files that the page speaks of."""
    (tmp_path / "nan.py").write_text(block("python"))
    stop = re.search(r"^    # stop\.py\n((?:    .*\n)+)", PAGE, re.MULTILINE).group(1)
    (tmp_path / "stop.py").write_text(re.sub(r"^    ", "", stop, flags=re.MULTILINE))
    (tmp_path / "plan.toml").write_text('[[inject]]\ntopic = "/odom"\nfield = "x"\nvalue = 1\n')
    rule = Rule(((Literal(Feature("mul", ("/map_updates:x", "/map_updates:y")), "<", 0),),)).to_dict()
    types = {"/map_updates:x": "int32", "/map_updates:y": "int32"}
    (tmp_path / "rule.json").write_text(json.dumps({"rule": rule, "types": types}))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_complete_example_prints_what_the_page_says(folder):
    paths = os.pathsep.join(str(ROOT / each) for each in (".", "adapters", "dictionaries"))
    command = [sys.executable, "nan.py"]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    assert done.stdout == block("text")


def test_the_class_in_five_lines(folder, bench):
    run = bench(from_text("stop.py"))
    for speed in (0.5, 1.5):
        run.feed(payload={"linear": {"x": speed}})
    assert run.payloads() == [b'{"linear": {"x": 0.5}}', b'{"linear": {"x": 0.0}}']


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_understood(folder, command):
    words = shlex.split(command)
    texts = [words[n + 1] for n, word in enumerate(words) if word == "--interceptor"]
    assert texts
    for text in texts:
        assert from_text(text)


def test_the_tables_of_riot_toml_mean_the_same_as_the_command():
    start = PAGE.index("    [[router.interceptors]]")
    text = re.sub(r"^    ", "", PAGE[start : PAGE.index("\n\nThe topics")], flags=re.MULTILINE)
    words = shlex.split(COMMANDS[0])
    assert from_tables(tomllib.loads(text)["router"]["interceptors"]) == [from_text(words[3]), from_text(words[5])]


def test_all_shipped_ones_and_their_options_are_on_the_page():
    sections = dict(re.findall(r"^### `(\w+)`: (.*?)(?=^##)", PAGE, re.MULTILINE | re.DOTALL))
    found = {each["name"]: each["options"] for each in interceptor_list()}
    assert list(sections) == list(found)
    for name, options in found.items():
        rows = re.findall(r"^\| `(\w+)` \| (\S+) \|", sections[name], re.MULTILINE)
        defaults = [
            "required" if option["required"] else "none" if option["default"] is None else option["default"]
            for option in options
        ]
        assert [option for option, _ in rows] == [option["name"] for option in options]
        assert [text.lower() for _, text in rows] == [str(default).lower() for default in defaults]
        assert f"--interceptor '{name} " in sections[name]


def test_all_conditions_are_on_the_page():
    table = PAGE[PAGE.index("## Conditions") : PAGE.index("## Lifecycle")]
    named = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE))))
    assert named == {*_CONDITIONS, "name"}
