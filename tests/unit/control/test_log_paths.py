from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.control.log_paths import claim, safe_path
from riot_bus.vocabulary.errors import ConfigError


@pytest.mark.parametrize(
    "text",
    ["../x.mcap", "/etc/x.mcap", "a/../../x.mcap", "link/x.mcap", "x.txt", "", "a\0.mcap", "no/x.mcap", "x\n.mcap"],
)
def test_paths_from_afar_stay_in_the_folder(text: str, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path)
    with pytest.raises(ConfigError):
        safe_path(folder, text)


def test_files_are_created_and_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    assert claim(tmp_path, "sub/x.mcap", "run") == tmp_path / "sub/x.mcap"
    assert claim(tmp_path, str(tmp_path / "y.mcap"), "run").is_file()
    (tmp_path / "z.mcap").symlink_to(tmp_path / "elsewhere.mcap")
    for text in ("sub/x.mcap", "y.mcap"):
        with pytest.raises(ConfigError, match="exists already"):
            claim(tmp_path, text, "run")
    assert [claim(tmp_path, None, "run").name for _ in range(3)] == ["run.mcap", "run-2.mcap", "run-3.mcap"]
