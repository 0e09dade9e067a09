from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import example, given, settings
from hypothesis import strategies as st

from riot_bus.cli import fastpath as quick
from riot_bus.cli.fastpath import fast_options, parse
from riot_bus.cli.main import make_app
from riot_bus.cli.options import OutputFormat
from riot_bus.control.router_flags import RouterOptions
from riot_bus.vocabulary.flags import flags_of

OPTIONS = {written: each for written, each in fast_options().items() if each.value is None}
SWITCHES = [each for each in fast_options() if each not in OPTIONS]


@cache
def declared() -> Any:
    return typer.main.get_group(make_app("router")).commands["router"]


def by_typer(arguments: list[str]) -> dict[str, Any]:
    """Return what the command is called with when typer reads its arguments."""
    with declared().make_context("router", list(arguments)) as context:
        return dict(context.params)


def test_the_table_is_what_is_declared() -> None:
    found = {}
    for parameter in declared().params:
        for written in (*parameter.opts, *parameter.secondary_opts):
            name = "as_json" if parameter.name == "form" else parameter.name
            found[written] = (name, getattr(parameter, "multiple", False), parameter.envvar or "")
    found.pop("--help", None)
    assert SWITCHES == ["--bypass-watch", "--no-bypass-watch"]
    assert found == {written: (each.name, each.many, each.variable) for written, each in fast_options().items()}


VALUES = {
    "seed": st.integers(0, 10**9).map(str),
    "budget": st.decimals(0, 1000, places=3).map(str),
    "as_json": st.sampled_from([each.value for each in OutputFormat]),
}
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    arguments: list[str] = []
    for _ in range(draw(st.integers(0, 5))):
        written = draw(st.sampled_from([*OPTIONS, *SWITCHES]))
        arguments.append(written)
        if written in OPTIONS:
            text = draw(st.one_of(VALUES.get(OPTIONS[written].name, TEXTS), TEXTS))
            if written.startswith("--") and draw(st.booleans()):
                arguments[-1] = f"{written}={text}"
            else:
                arguments.append(text)
    return arguments


@settings(deadline=None)
@given(command_lines())
@example(["--segment", "a=tcp/127.0.0.1:0", "--segment=b=tcp/127.0.0.1:0", "--record", "x.mcap", "--format", "json"])
@example(["--intercept", "robot/**", "--type", "/odom=nav_msgs/msg/Odometry", "--no-bypass-watch", "-s", "riot.toml"])
def test_what_is_understood_is_understood_as_typer_does(arguments: list[str]) -> None:
    found = parse(arguments, {})
    if found is not None:
        read = by_typer(arguments)
        read["as_json"] = read.pop("form") is OutputFormat.JSON
        usual = {each.name: each.default for each, _, _ in flags_of(RouterOptions)} | {"as_json": False}
        assert {
            name: usual[name] if value in (None, [], ()) else value
            for name, value in read.items()
            if name != "bypass_watch"
        } == {name: found.get(name, value) for name, value in usual.items() if name != "bypass_watch"}
        assert read["bypass_watch"] == found.get("bypass_watch", usual["bypass_watch"])


def test_what_people_write_is_understood() -> None:
    line = "--segment system=tcp/127.0.0.1:0 --segment=unit=tcp/127.0.0.1:0 --intercept /odom --seed 7 --budget 0.5"
    assert parse([*line.split(), "--no-bypass-watch", "-s", "riot.toml", "--format", "json"], {"HOME": "/"}) == {
        "segments": ["system=tcp/127.0.0.1:0", "unit=tcp/127.0.0.1:0"],
        "intercept": ["/odom"],
        "seed": 7,
        "budget": 0.5,
        "bypass_watch": False,
        "system": Path("riot.toml"),
        "as_json": True,
    }


@pytest.mark.parametrize(
    "line",
    [
        "env unit",
        "--help",
        "--segment",
        "--segment=",
        "--segmnt a=tcp/127.0.0.1:0",
        "--seg a=tcp/127.0.0.1:0",
        "--seed x",
        "--seed 1_0",
        "--seed -1",
        "--budget 1e3",
        "--name a --name b",
        "--format yaml",
        "-sriot.toml",
        "-s=riot.toml",
        "--bypass-watch --no-bypass-watch",
        "--record -- x",
    ],
)
def test_the_rest_is_left_to_typer(line: str) -> None:
    assert parse(line.split(), {}) is None


def test_variables_are_left_to_typer() -> None:
    for each in OPTIONS.values():
        if each.variable:
            assert parse([], {each.variable: "1"}) is None


def test_other_commands_are_left_to_typer() -> None:
    assert not quick.quick_start([])
    assert not quick.quick_start(["info", "x.mcap"])
    assert not quick.quick_start(["router", "--help"])
