"""Logs that dictionaries are looked at beside, and where dictionary files are."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.chain.steps.dictionaries import (
    errors_of,
    find_dictionary,
    list_dictionaries,
    log_to_apply_to,
    tables_applied,
)
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

OWN = '[[field]]\npath = "{}"\nentries = [{{ value = 9.5, reason = "fast" }}]\n'
SYSTEM = """
[system]
name = "press"
{nominal}

[components.drive]
command = ["true"]
inputs = ["drive"]

[unit.drive]
dictionaries = ["own.toml"]
leave = ["drive:mode"]
"""


def press(folder: Path, *, nominal: str = 'nominal = "run.mcap"', path: str = "speed") -> Path:
    with LogWriter(folder / "run.mcap") as writer:
        for number in range(10):
            for key in ("drive", "elsewhere"):
                payload = json.dumps({"speed": 1.5, "mode": "auto", key: 1}).encode()
                writer.write(Message(10**18 + number, key, payload, encoding="application/json"))
    (folder / "own.toml").write_text(OWN.format(path))
    (folder / "riot.toml").write_text(SYSTEM.format(nominal=nominal))
    return folder / "riot.toml"


def test_a_unit_looks_at_its_inputs_alone(tmp_path: Path) -> None:
    where = log_to_apply_to(None, press(tmp_path), None)
    assert where is not None
    assert (len(where.messages), where.name) == (10, f"inputs of drive in {tmp_path / 'run.mcap'}")
    assert errors_of(tmp_path / "own.toml", where)[1] == []
    name, text = find_dictionary("string")
    assert tables_applied(name, text, where)[1]["entry[0]"].left_alone == ("drive:mode",)


def test_a_log_alone_is_looked_at_whole(tmp_path: Path) -> None:
    press(tmp_path, path="elsewhere")
    where = log_to_apply_to(tmp_path / "run.mcap", None, None)
    assert where is not None
    assert len(where.messages) == 20
    (problem,) = errors_of(tmp_path / "own.toml", where)[1]
    assert "none of the values for 'elsewhere' fits elsewhere:elsewhere, which is a int64" in str(problem)
    unit = log_to_apply_to(tmp_path / "run.mcap", tmp_path / "riot.toml", "drive")
    (problem,) = errors_of(tmp_path / "own.toml", unit)[1]
    assert "no field of the log is called 'elsewhere'" in str(problem)


def test_without_a_log_the_file_alone_is_looked_at(tmp_path: Path) -> None:
    press(tmp_path, path="no.such.field")
    assert log_to_apply_to(None, None, None) is None
    counted, problems = errors_of(tmp_path / "own.toml", None)
    assert counted is not None
    assert (counted.fields, problems) == (1, [])
    (tmp_path / "own.toml").write_text("x = [")
    counted, (problem,) = errors_of(tmp_path / "own.toml", None)
    assert counted is None
    assert "not a TOML file" in str(problem)


def test_errors_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"names no nominal log[^?]*--log"):
        log_to_apply_to(None, press(tmp_path, nominal=""), None)
    with pytest.raises(ConfigError, match=r"--system riot\.toml"):
        log_to_apply_to(tmp_path / "run.mcap", None, "drive")
    with pytest.raises(ConfigError, match=r"no dictionary 'flot64'[^?]*'float64'"):
        find_dictionary("flot64")
    with pytest.raises(ConfigError, match="cannot read the dictionary"):
        raise errors_of(tmp_path / "none.toml", None)[1][0]


def test_all_are_listed_and_those_of_riot_toml_with_their_units(tmp_path: Path) -> None:
    shipped = list_dictionaries(None)
    assert {each.units for each in shipped} == {()}
    assert all(each.values or each.fields or each.mutations for each in shipped)
    *others, own = list_dictionaries(press(tmp_path))
    assert others == shipped
    assert (own.name, own.units, own.fields) == (str(tmp_path / "own.toml"), ("drive",), 1)
