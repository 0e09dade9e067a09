from __future__ import annotations

import sys
from pathlib import Path

from riot_bus.sut.sources import source_files
from riot_bus.sut.system import SystemFile


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
