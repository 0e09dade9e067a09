from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from riot_bus.plugin_options import REQUIRED, check_known, instance_of, options_of
from riot_bus.vocabulary.errors import ConfigError


@dataclass
class Declared:
    """A plug-in with options of all kinds."""

    rate: Annotated[float, Field(gt=0)]
    mode: Literal["fast", "slow"] = "slow"
    file: Path = Path("default")
    names: list[str] = field(default_factory=lambda: ["a"])
    state: int = field(default=0, init=False)


class Plain:
    """A plug-in that is no dataclass."""

    def __init__(self, count: int, other=None, *rest: int, scale: float = 1.0, **more: Any) -> None:
        if count < 0:
            raise ConfigError("count is negative", hint="count up")
        self.count, self.other, self.scale = count, other, scale
        if count > 99:
            raise OSError("no room")


class Bare:
    """A plug-in without options."""


class Unhinted:
    """A plug-in whose annotation uses a name that is not imported."""

    def __init__(self, count: NotImported = 1) -> None:  # type: ignore[name-defined]  # noqa: F821
        self.count = count


def where(option: str) -> str:
    return f"riot.toml: guard.{option}" if option else "riot.toml: guard"


def made(kind: type, **values: Any) -> Any:
    return instance_of(kind, values, where)


def refused(kind: type, **values: Any) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        made(kind, **values)
    return caught.value


def test_options_are_what_a_class_takes() -> None:
    assert {name: default for name, (_, default) in options_of(Declared).items()} == {
        "rate": REQUIRED,
        "mode": "slow",
        "file": Path("default"),
        "names": ["a"],
    }
    assert options_of(Plain) == {"count": ("int", REQUIRED), "other": ("", None), "scale": ("float", 1.0)}
    assert options_of(Bare) == {}


def test_values_are_checked_against_the_declared_types() -> None:
    assert made(Declared, rate="2.5", names=["x"]) == Declared(2.5, names=["x"])
    assert made(Plain, count="3", other=object).count == 3
    assert made(Unhinted, count="as it is").count == "as it is"
    error = refused(Declared, rate=-1)
    assert (error.where, error.message) == (
        "riot.toml: guard.rate",
        "rate: Input should be greater than 0 (got -1)",
    )
    assert "'fast' or 'slow'" in refused(Declared, rate=1, mode="medium").message
    assert refused(Plain, count="many").where == "riot.toml: guard.count"


def test_a_missing_option_is_named_with_all_that_there_are() -> None:
    error = refused(Declared, mode="fast")
    assert (error.message, error.where) == ("option 'rate' is missing", "riot.toml: guard")
    assert error.hint == "its options: rate, mode, file, names"


def test_what_the_class_itself_refuses_is_told_with_its_place() -> None:
    error = refused(Plain, count=-1)
    assert (error.message, error.where, error.hint) == ("count is negative", "riot.toml: guard", "count up")
    assert refused(Plain, count=100).message == "Plain raised OSError('no room')"
    assert refused(Bare, x=1).hint == "it takes no options"


def test_relative_paths_start_from_the_given_folder() -> None:
    for given, expected in (("a.txt", Path("/there/a.txt")), ("/a.txt", Path("/a.txt"))):
        assert instance_of(Declared, {"rate": 1, "file": given}, where, root=Path("/there")).file == expected
    assert made(Declared, rate=1, file="a.txt").file == Path("a.txt")


def test_the_first_unknown_option_is_refused_with_those_like_it() -> None:
    check_known({"rate": 1}, options_of(Declared), where)
    with pytest.raises(ConfigError, match="unknown option 'raet'") as caught:
        check_known({"raet": 1}, options_of(Declared), where)
    assert caught.value.where == "riot.toml: guard.raet"
    assert "'rate'" in str(caught.value.hint)
