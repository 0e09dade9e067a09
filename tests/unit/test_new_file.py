from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.new_file import new_file, new_file_mode, whole_file, write_whole
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError


def test_files_have_the_mode_of_any_new_file(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.touch()
    assert new_file_mode() == other.stat().st_mode & 0o777


@pytest.mark.parametrize("status", ["/proc/self/status", "/nonexistent"])
def test_it_is_what_the_umask_leaves(status: str) -> None:
    code = f"""
import os, pathlib
from riot_bus import new_file
new_file._STATUS = pathlib.Path({status!r})
os.umask(0o027)
print(oct(new_file.new_file_mode()), oct(os.umask(0)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "0o640 0o27\n"


def test_a_file_has_its_name_when_it_is_complete(tmp_path: Path) -> None:
    path, source = tmp_path / "out", tmp_path / "in"
    source.write_text("in")
    with new_file(path, source=source, force=False) as temporary:
        Path(temporary).write_text("out")
        assert not path.exists()
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("out", new_file_mode())
    with pytest.raises(ConfigError, match="the file exists"), new_file(path, source=source, force=False):
        pass
    with pytest.raises(ConfigError, match="the input itself"), new_file(source, source=source, force=True):
        pass
    with pytest.raises(EnvironmentFaultError, match="cannot write"), new_file(path / "x", source=source, force=True):
        pass
    with pytest.raises(KeyboardInterrupt), new_file(path, source=source, force=True):
        raise KeyboardInterrupt
    assert (path.read_text(), sorted(each.name for each in tmp_path.iterdir())) == ("out", ["in", "out"])


def test_a_file_is_replaced_in_one_step_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "out"
    write_whole(path, "é")
    write_whole(path, b"two", mode=0o600, sync=False)
    assert (path.read_bytes(), path.stat().st_mode & 0o777) == (b"two", 0o600)
    with pytest.raises(TypeError), whole_file(path) as temporary:
        temporary.write_text(3)  # type: ignore[arg-type]  # the mistake
    assert temporary.parent == tmp_path
    assert (path.read_bytes(), [each.name for each in tmp_path.iterdir()]) == (b"two", ["out"])
