"""Monitors are built from tables of riot.toml: shipped ones, those of other packages, and those in a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.invariants import Range, Values
from riot_bus.system.system_file import load_system
from riot_bus.trial.context import open_system
from riot_bus.vocabulary.errors import ConfigError

FILE = """
from dataclasses import dataclass
from riot_bus.vocabulary.trial import Violation

@dataclass(frozen=True)
class AtMost:
    topic: str
    count: int = 10
    @property
    def topics(self):
        return (self.topic,)
    def judge(self, view):
        many = len(view.outputs) > self.count
        return [Violation("at_most", self.topic, f"too much on {self.topic}")] if many else []
"""
SYSTEM = '[components.a]\ncommand = ["true"]\n[[monitors]]\nkind = "at_most.py"\ntopic = "t"\ncount = 3\n'


def build(tmp_path: Path, **table):
    return build_monitor(table, where=lambda key: f"here.{key}", root=tmp_path)


def test_shipped_ones_get_their_options(tmp_path: Path) -> None:
    assert build(tmp_path, kind="range", field="a:x", min=1, max=2.5) == Range("a:x", 1.0, 2.5)
    assert build(tmp_path, kind="values", field="a:x", allowed=[1, 2]) == Values("a:x", (1, 2))


@pytest.mark.parametrize(
    ("table", "where", "words"),
    [
        ({}, "here.kind", ["which monitor", "range"]),
        ({"kind": "rnage"}, "here.kind", ["unknown monitor", "range"]),
        ({"kind": "range", "field": "a:x", "mni": 1}, "here.mni", ["unknown option 'mni'", "min"]),
        ({"kind": "range"}, "here.", ["'field' is missing"]),
        ({"kind": "range", "field": "a:x", "min": float("nan")}, "here.min", ["min", "nan"]),
        ({"kind": "values", "field": "a:x", "allowed": []}, "here.allowed", ["allowed", "at least 1"]),
        ({"kind": "never", "when": "a where x ="}, None, ["x ="]),
        ({"kind": "none.py"}, None, ["no such file"]),
    ],
)
def test_mistakes_say_where_and_what(tmp_path: Path, table, where, words) -> None:
    with pytest.raises(ConfigError) as caught:
        build(tmp_path, **table)
    assert where is None or caught.value.where == where
    for word in words:
        assert word in str(caught.value)


def test_one_in_a_file_is_found_beside_riot_toml_and_judges(tmp_path: Path) -> None:
    (tmp_path / "at_most.py").write_text(FILE)
    (tmp_path / "riot.toml").write_text(SYSTEM)
    (monitor,) = load_system(tmp_path / "riot.toml").invariants
    assert monitor.topics == ("t",)
    assert monitor.count == 3


def test_one_of_another_package_is_named_like_a_shipped_one(tmp_path: Path, plugin_package) -> None:
    plugin_package(FILE, "riot_bus.monitors", at_most="AtMost", number="__name__")
    assert build(tmp_path, kind="at_most", topic="t").topics == ("t",)
    with pytest.raises(ConfigError, match="is not a class"):
        build(tmp_path, kind="number")


def test_the_fingerprint_of_a_system_covers_its_monitors(tmp_path: Path) -> None:
    (tmp_path / "at_most.py").write_text(FILE)
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM)
    before = open_system(path).fingerprint()
    path.write_text(SYSTEM.replace("count = 3", "count = 4"))
    assert open_system(path).fingerprint() != before
    path.write_text(SYSTEM)
    assert open_system(path).fingerprint() == before
    (tmp_path / "at_most.py").write_text(FILE.replace("> self.count", ">= self.count"))
    assert open_system(path).fingerprint() != before, "the monitor judges otherwise now"


def test_one_in_a_file_elsewhere_is_covered_as_well(tmp_path: Path) -> None:
    file = tmp_path / "of [others]" / "at_most.py"
    file.parent.mkdir()
    file.write_text(FILE)
    path = tmp_path / "riot.toml"
    path.write_text(SYSTEM.replace("at_most.py", str(file)))
    before = open_system(path).fingerprint()
    file.write_text(FILE.replace("> self.count", ">= self.count"))
    assert open_system(path).fingerprint() != before
