"""Values of placeholders: each trial has its own ports, and copies of files with these filled in."""

from __future__ import annotations

import sys
from pathlib import Path

from riot_bus.system.system_file import RunPace, load_system
from riot_bus.trial.placeholders import Placeholders, fill

SYSTEM = """
[components.part]
command = ["part", "{free_port:a}", "{free_port:a}", "{free_port}", "{file:conf/part.json}", "{param:on}"]
files = ["conf/part.json"]
[external.parameters]
on = { nominal = true }
"""


def placeholders(folder: Path) -> Placeholders:
    (folder / "conf").mkdir()
    (folder / "conf/part.json").write_text("{segment} {seed} {speed} {unknown}")
    (folder / "trial").mkdir()
    path = folder / "riot.toml"
    path.write_text(SYSTEM.replace('files = ["conf/part.json"]\n', ""))
    return Placeholders(load_system(path), folder / "trial", slot=3, parameters={"on": True})


def test_a_component_gets_all_values_and_its_files_with_them(tmp_path: Path) -> None:
    words = placeholders(tmp_path).of_component(
        "part", "tcp/127.0.0.1:1", segment="inner", seed=7, pace=RunPace(duration=2.5, speed=2)
    )
    expected = {"{python}": sys.executable, "{slot}": "3", "{seed}": "7", "{duration}": "2.5", "{param:on}": "true"}
    assert {word: words[word] for word in expected} == expected
    assert words["{free_port:a}"] != words["{free_port}"]
    copy = Path(words["{file:conf/part.json}"])
    assert copy.parent == tmp_path / "trial"
    assert copy.read_text() == "inner 7 2 {unknown}"


def test_a_port_stays_the_same_in_all_of_a_trial(tmp_path: Path) -> None:
    words = placeholders(tmp_path)
    first = words.of_command(("reset", "{free_port:a}"))
    assert first["{free_port:a}"] == str(words.free_port("{free_port:a}"))
    assert "{seed}" not in first
    assert fill("{slot}:{free_port:a}", first) == f"3:{first['{free_port:a}']}"
