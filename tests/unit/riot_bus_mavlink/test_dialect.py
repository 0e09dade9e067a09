from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.dialect import Dialect, dialect_names, load_dialect


def message(number: int, name: str, *fields: str) -> str:
    inside = "".join(f'<field type="uint8_t" name="{field}"/>' for field in fields or ("x",))
    return f'<message id="{number}" name="{name}">{inside}</message>'


def write(file: Path, *messages: str, include: str = "", enums: str = "") -> Path:
    included = f"<include>{include}</include>" if include else ""
    text = "".join(messages)
    file.write_text(f"<mavlink>{included}<enums>{enums}</enums><messages>{text}</messages></mavlink>")
    return file


def load(*files: Path) -> Dialect:
    return load_dialect("", files)


def test_messages_are_known_by_id_and_by_name(tmp_path: Path) -> None:
    found = load(write(tmp_path / "own.xml", message(7, "MINE", "x", "target_component", "target_system")))
    mine = found.message("MINE")
    assert mine is not None
    assert (found.id_of("MINE"), found.name_of(7), found.crc_extra(7)) == (7, "MINE", mine.crc_extra)
    assert found.targets(7) == (2, 1)
    assert (found.message("OTHER"), found.crc_extra(8), found.targets(8)) == (None, None, (None, None))


@pytest.mark.parametrize("number", [0, 8, 16_777_215])
def test_unknown_messages_have_names_that_tell_their_id(number: int) -> None:
    empty = Dialect("", [])
    assert empty.id_of(empty.name_of(number)) == number


@pytest.mark.parametrize(
    "name", ["UNKNOWN_", "UNKNOWN_x", "UNKNOWN_-1", "UNKNOWN_²", "UNKNOWN_٣", "OTHER", "UNKNOWN_" + 99 * "1"]
)
def test_other_names_tell_none(name: str) -> None:
    assert Dialect("", []).id_of(name) is None


def test_a_file_replaces_what_it_includes_by_id_and_by_name(tmp_path: Path) -> None:
    write(tmp_path / "base.xml", message(1, "ONE"), message(2, "TWO"), message(3, "THREE"))
    found = load(write(tmp_path / "own.xml", message(1, "UNO"), message(9, "TWO"), include="base.xml"))
    assert {number: each.name for number, each in found.messages.items()} == {3: "THREE", 1: "UNO", 9: "TWO"}
    assert (found.id_of("ONE"), found.id_of("TWO"), found.message("ONE")) == (None, 9, None)


def test_files_that_include_each_other_are_read_once(tmp_path: Path) -> None:
    write(tmp_path / "a.xml", message(1, "ONE"), include="b.xml")
    write(tmp_path / "b.xml", message(2, "TWO"), include="a.xml")
    assert set(load(tmp_path / "a.xml", tmp_path / "b.xml").messages) == {1, 2}


def test_enums_of_several_files_add_up(tmp_path: Path) -> None:
    one = '<enum name="E" bitmask="true"><entry value="1" name="A"/><entry value="2" name="B"/></enum>'
    two = '<enum name="E"><entry value="2" name="C"/><entry value="4" name="D"/></enum>'
    write(tmp_path / "base.xml", enums=one)
    enum = load(write(tmp_path / "own.xml", enums=two, include="base.xml")).enums["E"]
    assert (enum.bitmask, {value: entry.name for value, entry in enum.entries.items()}) == (
        True,
        {1: "A", 2: "C", 4: "D"},
    )


def test_a_chain_of_files_without_end_ends(tmp_path: Path) -> None:
    for number in range(300):
        write(tmp_path / f"{number}.xml", include=f"{number + 1}.xml")
    with pytest.raises(ConfigError, match="files are included"):
        load(tmp_path / "0.xml")


def test_what_cannot_be_loaded(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load(tmp_path / "nothing.xml")
    with pytest.raises(ConfigError, match="unknown dialect 'comon'") as error:
        load_dialect("comon")
    assert "common" in str(error.value.hint)


def test_shipped_dialects_are_listed_and_can_be_extended(tmp_path: Path) -> None:
    assert {"all", "common", "minimal"} <= set(dialect_names())
    found = load_dialect("minimal", [write(tmp_path / "own.xml", message(7, "MINE"), include="minimal.xml")])
    assert (found.name, found.name_of(0), found.name_of(7)) == ("minimal", "HEARTBEAT", "MINE")
