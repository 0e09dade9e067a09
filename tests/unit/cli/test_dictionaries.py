"""`riot dict`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.inject.dictionary_file import json_schema
from tests.unit.chain.steps.test_dictionaries import press


def riot(*words: object, code: int = 0) -> tuple[str, str]:
    done = CliRunner().invoke(make_app("dict"), ["dict", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == code, done.output
    return done.stdout, done.stderr


def test_list(tmp_path: Path) -> None:
    out, _ = riot("list")
    assert out.splitlines()[0].split() == ["dictionary", "values", "fields", "mutations"]
    assert any(line.split()[0] == "riot_bus_dictionaries/float64.toml" for line in out.splitlines()[1:])
    out, _ = riot("list", "--system", press(tmp_path))
    assert out.splitlines()[-1].split() == [str(tmp_path / "own.toml"), "1", "drive"]
    found = json.loads(riot("list", "--format", "json")[0])
    assert all(each["values"] + each["fields"] + each["mutations"] for each in found)


def test_show(tmp_path: Path) -> None:
    out, _ = riot("show", "float64")
    assert "float64  nan" in out
    out, _ = riot("show", "sensor_msgs")
    assert "message sensor_msgs/msg/Image\n  consistent: len(data) == step * height\n  height = height + 1  " in out
    found = json.loads(riot("show", "float64", "--format", "json")[0], parse_constant=pytest.fail)
    assert {"value": "nan", "reason": "not a number: every comparison is false, so !(x < limit) passes it on"} in found[
        "file"
    ]["entry"]
    press(tmp_path)
    text = "[[field]]\npath = 'mode'\nonly = true\nentries = [{ value = { repeat = 'A', times = 99 }, reason = 'r' }]"
    (tmp_path / "own.toml").write_text(text)
    out, _ = riot("show", tmp_path / "own.toml")
    assert "field mode (nothing else)\n  99 x 'A'  r\n" in out
    assert "->" not in out


def test_show_beside_a_log(tmp_path: Path) -> None:
    system = press(tmp_path)
    out, _ = riot("show", tmp_path / "own.toml", "--system", system)
    assert out.splitlines()[-1] == "  -> drive:speed"
    out, _ = riot("show", "string", "--system", system)
    assert out.splitlines()[-1] == "  left alone, or nothing to change: drive:mode"
    out, _ = riot("show", "int8", "--log", tmp_path / "run.mcap")
    assert out.splitlines()[-1] == "  -> nothing in this log"
    found = json.loads(riot("show", tmp_path / "own.toml", "--log", tmp_path / "run.mcap", "--format", "json")[0])
    assert found["applies"] == {"field[0]": {"fields": ["drive:speed", "elsewhere:speed"], "left_alone": []}}


def test_validate(tmp_path: Path) -> None:
    system = press(tmp_path)
    own = tmp_path / "own.toml"
    out, _ = riot("validate", own)
    assert out.strip() == f"{own}: 0 values, 1 bindings, 0 mutations; not compared with a log (--log, --system)"
    out, _ = riot("validate", own, "--system", system)
    assert "all can apply to inputs of drive in" in out
    press(tmp_path, path="sped")
    out, err = riot("validate", own, "--system", system, code=2)
    assert (out, err.splitlines()) == (
        "",
        [f"riot: {own}: field[0]: no field of the log is called 'sped'", "  hint: did you mean 'speed'?"],
    )
    found = json.loads(riot("validate", own, "--log", tmp_path / "run.mcap", "--format", "json", code=2)[0])
    assert [each["where"] for each in found["errors"]] == [f"{own}: field[0]"]
    own.write_text("[[entry]]\nvalue = 1")
    assert "entry[0].reason" in riot("validate", own, code=2)[1]


def test_schema() -> None:
    assert json.loads(riot("schema")[0]) == json_schema()
