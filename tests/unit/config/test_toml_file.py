from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, ValidationError

from riot_bus.config.toml_file import MistakeError, explained, explained_key, line_of, place_of, read_toml
from riot_bus.vocabulary.errors import ConfigError

TEXT = "[a]\nx = 1\n[a.b]\nx = 2\n'y' = 3\n"


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    x: int | str = 0


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid")
    a: Inner = Inner()
    b: list[Inner] = []


def wrong(document: object) -> ValidationError:
    with pytest.raises(ValidationError) as caught:
        Table.model_validate(document)
    return caught.value


@pytest.mark.parametrize(("place", "line"), [(["a", "x"], 2), (["a", "b", "x"], 4), (["a", "b", "y"], 5), (["z"], 1)])
def test_the_line_of_a_key_is_that_in_its_own_table(place: list[str], line: int) -> None:
    assert line_of(TEXT, place) == line
    assert place_of(Path("f"), TEXT, place).startswith(f"f:{line}")


def test_an_unknown_key_is_told_with_line_table_and_the_nearest_one() -> None:
    found = explained(wrong({"a": {"xx": 1}}), Path("f"), "[a]\nxx = 1", lambda place: ["x"] if place == ["a"] else [])
    assert (found.message, found.where, found.hint) == ("unknown key 'xx'", "f:2: [a]", "did you mean 'x'?")


def test_a_mistake_keeps_its_hint_and_leads_to_its_key() -> None:
    class Checked(BaseModel):
        def model_post_init(self, _: object) -> None:
            raise MistakeError("no", hint="yes", place=["x"])

    with pytest.raises(ValidationError) as caught:
        Checked.model_validate({})
    found = explained(caught.value, Path("f"), "[a]\nx = 1", lambda _: [], prefix=["a"])
    assert (found.message, found.where, found.hint) == ("no", "f:2: [a]", "yes")


def test_a_key_is_told_by_its_path_without_the_alternatives_of_its_value() -> None:
    def told(document: object) -> ConfigError:
        return explained_key(wrong(document), "f", ("int", "str"), lambda place: Table if len(place) == 1 else Inner)

    assert told({"b": [{}, {"x": None}]}).where == "f: b[1].x"
    assert told({"b": [{}, {"x": None}]}).message.endswith("(found None)")
    unknown = told({"b": [{"int": 1}]})
    assert (unknown.message, unknown.where, unknown.hint) == ("unknown key 'int'", "f: b[0].int", "known: x")


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    with pytest.raises(ConfigError, match="cannot read the system file"):
        read_toml(path)
    path.write_bytes(b"a = \xff")
    with pytest.raises(ConfigError, match="not UTF-8"):
        read_toml(path)
    path.write_text("a = 1")
    assert read_toml(path) == ({"a": 1}, "a = 1")
