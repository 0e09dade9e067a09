from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from riot_bus.report.reproduce import write_reproduce


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


def test_arguments_are_quoted(tmp_path: Path, recorder: dict[str, str]) -> None:
    script = write_reproduce(tmp_path, arguments=("--system", "my file's; rm -rf x", "a\nb", ""))
    done = subprocess.run([script], env=recorder, capture_output=True, text=True, check=False)
    assert done.stdout == f"<reproduce><{tmp_path}><--system><my file's; rm -rf x><a\nb><>"


def test_file(tmp_path: Path) -> None:
    script = write_reproduce(tmp_path)
    assert script == tmp_path / "reproduce.sh"
    assert os.access(script, os.X_OK)
    lines = script.read_text().splitlines()
    assert len(lines) == 2
    assert lines[0] == "#!/bin/sh"
    assert write_reproduce(tmp_path).read_text().splitlines() == lines
    assert [path.name for path in tmp_path.iterdir()] == ["reproduce.sh"]
