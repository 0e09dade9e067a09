from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.record.naming import Naming
from riot_bus.record.options import CaptureOptions
from riot_bus.vocabulary.errors import ConfigError


def naming(**options: Any) -> Naming:
    return Naming(CaptureOptions(**options))


def test_files_are_numbered_and_existing_ones_left_alone(tmp_path: Path) -> None:
    (tmp_path / "run-2.mcap").write_bytes(b"precious")
    names = naming(output=tmp_path / "run.mcap")
    made = [names.next() for _ in range(3)]
    assert [path.name for path in made] == ["run.mcap", "run-3.mcap", "run-4.mcap"]
    assert {path.stat().st_mode & 0o777 for path in made} == {0o600}
    (tmp_path / "run.mcap").unlink()
    assert names.next().name == "run-5.mcap"
    assert (tmp_path / "run-2.mcap").read_bytes() == b"precious"


def test_without_a_name_it_is_date_and_time(tmp_path: Path) -> None:
    for options in ({"folder": tmp_path}, {"output": tmp_path}):
        path = naming(robot="rosie", **options).next()
        assert path.parent == tmp_path
        assert path.name.startswith("rosie-20")
        path.unlink()


def test_a_bag_is_a_folder(tmp_path: Path) -> None:
    names = naming(output=tmp_path / "bag", bag=True)
    assert [names.next() for _ in range(2)] == [tmp_path / "bag" / "bag_0.mcap", tmp_path / "bag" / "bag_1.mcap"]
    with pytest.raises(ConfigError, match="the files of a bag"):
        names.next("x.mcap")
    with pytest.raises(ConfigError, match="exists already"):
        naming(output=tmp_path / "bag", bag=True).next()
    again = naming(output=tmp_path / "bag", bag=True, overwrite=True)
    assert again.next().name == "bag_0.mcap"
    assert [each.name for each in (tmp_path / "bag").iterdir()] == ["bag_0.mcap"]


def test_names_from_afar_stay_in_the_folder(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    names = naming(output=tmp_path / "a.mcap", folder=tmp_path / "logs")
    assert names.next("b.mcap") == tmp_path / "logs" / "b.mcap"
    for text in ("../a.mcap", "b.mcap", "/tmp/x.mcap", "c.txt"):
        with pytest.raises(ConfigError):
            names.next(text)


@pytest.mark.parametrize("output", ["a.txt", "missing/a.mcap", "a"])
def test_what_is_no_name(tmp_path: Path, output: str) -> None:
    with pytest.raises(ConfigError):
        naming(output=tmp_path / output).next()
    assert not list(tmp_path.iterdir())


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").symlink_to(tmp_path / "elsewhere.mcap")
    with pytest.raises(ConfigError, match="exists already"):
        naming(output=tmp_path / "a.mcap").next()
    assert not (tmp_path / "elsewhere.mcap").exists()
