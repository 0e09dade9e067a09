"""What a system's context says of its monitors, and what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from riot_bus.system.system_file import SystemFile
from riot_bus.trial import context as sources
from riot_bus.trial.context import invariants_of, open_system, source_files
from riot_bus.vocabulary.errors import ConfigError

SYSTEM = """
[components.arm]
command = ["arm"]
outputs = ["arm/state"]
[components.eye]
command = ["eye"]
outputs = ["eye/state"]
[unit.arm]
command = ["arm", "--checked"]
[[monitors]]
kind = "range"
field = "arm/state:x"
max = 1
[[monitors]]
kind = "range"
field = "eye/state:x"
max = 1
"""


def written(folder: Path, text: str = SYSTEM) -> Path:
    path = folder / "riot.toml"
    path.write_text(text)
    return path


def test_a_component_alone_is_judged_by_the_monitors_of_its_own_topics(tmp_path: Path) -> None:
    context = open_system(written(tmp_path))
    assert context.watched == ["arm/state", "eye/state"]
    own = {topic for monitor in context.monitors_of("arm") for topic in getattr(monitor, "topics", ())}
    assert own == {"arm/state"}
    assert context.others_publish("eye/state", "arm")
    assert not context.others_publish("arm/state", "arm")


def test_a_unit_with_a_command_of_its_own_has_another_context(tmp_path: Path) -> None:
    context = open_system(written(tmp_path))
    alone = context.alone("arm")
    assert alone.file.components["arm"].command == ("arm", "--checked")
    assert alone.hangs is context.hangs
    assert context.fingerprint() == open_system(tmp_path / "riot.toml").fingerprint()


def test_definitions_that_are_missing_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        open_system(written(tmp_path, f'[system]\nmessages = ["none.msg"]\n{SYSTEM}'))


def test_invariants_are_read_without_a_trial(tmp_path: Path) -> None:
    assert len(invariants_of(written(tmp_path))) == 2
    with pytest.raises(ConfigError, match="there is no such system file"):
        invariants_of(tmp_path / "other.toml")


def files(root: Path, *command: str, **system: object) -> set[str]:
    table = {"system": system, "components": {"part": {"command": command, "cwd": "work"}}, "path": root / "riot.toml"}
    return {str(path.relative_to(root)) for path in source_files(SystemFile.model_validate(table))}


def make(root: Path, *names: str) -> None:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)


def test_what_components_may_load_is_their_code(tmp_path: Path) -> None:
    make(tmp_path, "node.py", "work/lib/core.so", "work/run.sh", "work/data.csv", "out/trials/x.py")
    make(tmp_path, ".git/x.py", "env/pyvenv.cfg", "env/lib/x.py", "__pycache__/x.py")
    assert files(tmp_path, "./run.sh", "data.csv", "{endpoint}") == {
        "node.py",
        "work/lib/core.so",
        "work/run.sh",
        "work/data.csv",
    }


def test_the_command_of_a_unit_alone_counts_too(tmp_path: Path) -> None:
    make(tmp_path, "work/run.sh", "debug/run.sh", "debug/lib.so", "work/other.csv")
    table = {
        "components": {"part": {"command": ["./run.sh"], "cwd": "work"}},
        "unit": {"part": {"command": ["./run.sh"], "cwd": "debug"}, "same": {"component": "part"}},
        "path": tmp_path / "riot.toml",
    }
    found = {str(path.relative_to(tmp_path)) for path in source_files(SystemFile.model_validate(table))}
    assert found == {"work/run.sh", "debug/run.sh", "debug/lib.so"}


def test_sources_that_are_named_are_all(tmp_path: Path) -> None:
    make(tmp_path, "a.py", "b.py")
    assert files(tmp_path, "b.py", sources=["a.*"]) == {"a.py"}


def test_a_program_is_found_as_a_shell_finds_it(tmp_path: Path) -> None:
    table = {"components": {"part": {"command": ["sh", "-c", "exit"]}}, "path": tmp_path / "riot.toml"}
    (found,) = source_files(SystemFile.model_validate(table))
    assert found.name == "sh"
    table["components"] = {"part": {"command": [sys.executable, "no.py"]}}
    assert source_files(SystemFile.model_validate(table)) == [Path(sys.executable).resolve()]


def test_programs_that_only_a_script_names_are_code(tmp_path: Path) -> None:
    make(tmp_path, "work/run.sh", "work/build/data.bin", "work/build/libcore.so.2")
    for name, begin in (("node", b"\x7fELF"), ("start", b"#!/bin/sh"), ("image", b"\x89PNG")):
        (tmp_path / "work/build" / name).write_bytes(begin)
        (tmp_path / "work/build" / name).chmod(0o755)
    programs = {"work/build/node", "work/build/start", "work/build/libcore.so.2"}
    assert files(tmp_path, "./run.sh") == {"work/run.sh", *programs}


def test_definitions_of_messages_count(tmp_path: Path) -> None:
    make(tmp_path, "a.py", "Pose.msg")
    assert files(tmp_path, "a", sources=["a.py"], messages=["Pose.msg"]) == {"a.py", "Pose.msg"}


def test_more_files_than_are_looked_at_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sources, "_MOST", 2)
    make(tmp_path, "a.py", "b.py")
    assert files(tmp_path, "no") == {"a.py", "b.py"}
    assert caplog.messages == []
    make(tmp_path, "c.py")
    assert files(tmp_path, "no") == {"a.py", "b.py"}
    (told,) = caplog.messages
    assert told.startswith(f"more than 2 files of code are below {tmp_path}")
