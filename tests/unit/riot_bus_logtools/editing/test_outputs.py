from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.options import EditOptions
from riot_bus_logtools.editing.output_set import Outputs


def outputs(output: Path, **more: Any) -> Outputs:
    inputs = more.pop("inputs", [])
    return Outputs(EditOptions(inputs=inputs, output=output, **more), inputs)


def test_files_have_their_names_when_all_are_complete(tmp_path: Path) -> None:
    found = outputs(tmp_path / "a.mcap", split_topics=True)
    paths = [found.path(label) for label in ("0", "/odom: raw", "odom raw")]
    for path, _ in paths:
        path.write_text("x")
    assert [Path(final).name for _, final in paths] == ["a_0.mcap", "a_odom_raw.mcap", "a_odom_raw-2.mcap"]
    assert list(tmp_path.glob("*.mcap")) == []
    found.commit()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a_0.mcap", "a_odom_raw-2.mcap", "a_odom_raw.mcap"]


def test_what_is_discarded_leaves_nothing_behind(tmp_path: Path) -> None:
    found = outputs(tmp_path / "a.mcap")
    found.path(None)[0].write_text("x")
    found.discard()
    found.discard()
    assert list(tmp_path.iterdir()) == []


def test_no_file_is_replaced_unless_that_is_wanted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("before")
    with pytest.raises(ConfigError, match="exists"):
        outputs(path)
    with pytest.raises(ConfigError, match="the same"):
        outputs(path, force=True, inputs=[path])
    found = outputs(path, force=True)
    found.path(None)[0].write_text("after")
    found.commit()
    assert path.read_text() == "after"


def test_a_folder_is_only_replaced_if_it_is_a_bag(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "old.mcap").touch()
    with pytest.raises(ConfigError, match="not empty"):
        outputs(folder)
    found = outputs(folder, force=True)
    found.path(None)[0].write_text("x")
    found.metadata("text")
    found.commit()
    assert sorted(each.name for each in folder.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    (folder / "letter.txt").touch()
    with pytest.raises(ConfigError, match="other things than a bag"):
        outputs(folder, force=True)


def test_a_dry_run_checks_and_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch()
    outputs(tmp_path / "a.mcap", dry_run=True).commit()
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]
