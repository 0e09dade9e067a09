"""Writing a system file; what a live network says of itself is tested with one, in tests/integration."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.draft.init import check_path, write_system
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.chain.machine import SYSTEM


def test_a_system_file_is_only_replaced_by_force(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    check_path(path, force=False)
    write_system(path, SYSTEM, force=False)
    for call in (lambda: check_path(path, force=False), lambda: write_system(path, SYSTEM, force=False)):
        with pytest.raises(ConfigError, match="there is a system file already"):
            call()
    check_path(path, force=True)
    write_system(path, SYSTEM.replace("machine", "other"), force=True)
    assert 'name = "other"' in path.read_text()


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write the system file"):
        write_system(tmp_path / "none" / "riot.toml", SYSTEM, force=False)


def test_what_is_no_system_file_is_never_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Field required"):
        write_system(tmp_path / "riot.toml", "", force=False)
    assert list(tmp_path.iterdir()) == []
