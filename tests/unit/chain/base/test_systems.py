"""Whose commands the steps start, and what is read of the system file that a finding names."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from riot_bus.chain.base.systems import described, find_example, system_of
from riot_bus.findings.records import FindingRecord
from riot_bus.vocabulary.errors import ConfigError

EVIL = """
[system]
types = {"pos" = "json"}
reset = {command = ["%(canary)s.reset"]}
[components.planner]
command = ["sh", "-c", "echo started >> %(canary)s"]
setup = ["sh", "-c", "echo setup >> %(canary)s"]
[components.box]
container = {image = "box", engine = "%(canary)s.engine"}
[[monitors]]
kind = "m.py"
[unit.planner]
"""


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """The folder of a stranger's finding, in an archive with a system file whose monitor would write a file."""
    folder = tmp_path / "work" / "bug-77" / "findings" / "crash-planner"
    folder.mkdir(parents=True)
    text = EVIL % {"canary": tmp_path / "RAN"}
    (tmp_path / "work/bug-77/riot.toml").write_text(text)
    (tmp_path / "work/bug-77/m.py").write_text(f"open({str(tmp_path / 'RAN')!r}, 'a').write('monitor')\n")
    FindingRecord(
        id="x", system="s", system_file="../../riot.toml", unit="planner", component="planner", monitor="crash",
        signature="x",
    ).save(folder)  # fmt: skip
    return folder


def chosen(folder: Path, *, named: Path | None = None, root: Path = Path()) -> Path:
    return system_of(FindingRecord.load(folder).system_file, folder, named=named, root=root)


def test_what_a_stranger_s_file_would_start_is_told_and_not_started(theirs: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        chosen(theirs, root=tmp_path / "work")
    text = str(caught.value)
    for part in (
        "bug-77/riot.toml",
        "m.py (a monitor)",
        "(setup of planner)",
        "(command of planner)",
        "RAN.engine",
        "(a reset)",
    ):
        assert part in text
    assert "--system" in text
    assert not (tmp_path / "RAN").exists()


def test_the_project_s_own_file_comes_first(theirs: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    own = tmp_path / "work" / "riot.toml"
    own.write_text("")
    assert chosen(theirs, root=tmp_path / "work") == own
    assert "bug-77/riot.toml; taking" in caplog.text
    named = theirs.parents[1] / "riot.toml"
    assert chosen(theirs, root=tmp_path / "work", named=named) == named  # whoever names it has seen it


def test_a_file_of_the_same_project_is_taken_and_none_beside_the_finding(theirs: Path, tmp_path: Path) -> None:
    root = tmp_path / "work"
    own = root / "robots" / "a" / "riot.toml"
    own.parent.mkdir(parents=True)
    own.write_text("")
    assert system_of(str(own), root / "riot-out/findings/x", root=root) == own
    for path, folder in (
        (own, root / "robots/a/riot-out/findings/x"),  # as if both came in one archive
        (own, root / "robots/b/findings/x"),
        (tmp_path / "elsewhere.toml", root / "riot-out/findings/x"),
    ):
        path.write_text("[components.a]\ncommand = ['a']\n")
        with pytest.raises(ConfigError, match=r"`a` \(command of a\)"):
            system_of(str(path), folder, root=root)
    (root / "lent").symlink_to(theirs.parents[1])  # a link does not make it the project's
    with pytest.raises(ConfigError, match="not this project's"):
        system_of(str(root / "lent/riot.toml"), theirs, root=root)


def test_riot_s_own_examples_are_taken_from_anywhere(tmp_path: Path) -> None:
    example = find_example("rover")
    assert system_of(str(example), tmp_path / "riot-out/findings/x", root=tmp_path) == example


def test_without_any_file_it_says_where_it_looked(tmp_path: Path) -> None:
    for recorded in (None, "/build/riot.toml"):
        with pytest.raises(ConfigError, match=r"there is no riot\.toml in"):
            system_of(recorded, tmp_path, root=tmp_path)


def test_a_file_is_described_without_what_it_names(theirs: Path, tmp_path: Path) -> None:
    file, registry = described(theirs)
    assert file is not None
    assert list(file.components) == ["planner", "box"]
    assert (kind := registry.type_of("pos")) is not None
    assert kind.name == "json"
    assert not (tmp_path / "RAN").exists()
    assert file.invariants == ()


@pytest.mark.parametrize("text", ["[", "a." * 20_000 + "a = 1", 'system = {messages = ["../../none.msg"]}'])
def test_what_cannot_be_described_is_told(theirs: Path, text: str, caplog: pytest.LogCaptureFixture) -> None:
    (theirs.parents[1] / "riot.toml").write_text(text)
    with caplog.at_level(logging.WARNING):
        assert described(theirs)[0] is None
    assert "types are those in the finding's log" in caplog.text
    with pytest.raises(ConfigError):
        described(theirs, named=theirs.parents[1] / "riot.toml")
