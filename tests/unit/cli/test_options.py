from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from riot_bus.cli.declared import declared
from riot_bus.cli.options import DEFAULT_SYSTEM, OutputFormat, RunOptions, StreamFormat, System, Tolerance, Types
from riot_bus.vocabulary.flags import flags_of


def options(*words: str, **environment: str) -> RunOptions | str:
    """Return the options that a command gets, or the complaint about them."""
    app, found = typer.Typer(rich_markup_mode=None), []

    @app.command()
    @declared(RunOptions)
    def run(**given: Any) -> None:
        found.append(RunOptions(**given))

    result = CliRunner().invoke(app, words, env=environment)
    return found[0] if found else result.output


def test_without_options_all_is_as_declared() -> None:
    assert options() == RunOptions()


def test_options_have_short_names_and_variables() -> None:
    expected = RunOptions(out=Path("o"), jobs=3, seed=7, form=StreamFormat.NDJSON)
    assert options("-o", "o", "-j", "3", "--seed", "7", "--format", "ndjson") == expected
    assert options(RIOT_OUT="o", RIOT_JOBS="3", RIOT_SEED="7", RIOT_FORMAT="ndjson") == expected
    assert options("--jobs", "1", RIOT_JOBS="3") == RunOptions(jobs=1)


def test_reports_are_repeatable() -> None:
    found = options("--report", "junit", "--report", "sarif=a.json")
    assert isinstance(found, RunOptions)
    assert list(found.reports) == ["junit", "sarif=a.json"]


@pytest.mark.parametrize("words", [("--jobs", "-1"), ("--format", "xml"), ("--seed", "x")])
def test_wrong_values_are_refused(words: tuple[str, str]) -> None:
    complaint = str(options(*words))
    assert "Invalid value for" in complaint
    assert words[0] in complaint


def test_no_name_and_no_variable_is_used_twice() -> None:
    flags = flags_of(RunOptions)
    assert max(Counter(name for _, _, names in flags for name in names).values()) == 1
    assert max(Counter(flag.env for _, flag, _ in flags if flag.env).values()) == 1


def test_commands_with_events_know_all_other_forms_too() -> None:
    assert {each.value for each in OutputFormat} < {each.value for each in StreamFormat}


def test_shared_options_of_typer_take_what_their_help_says() -> None:
    app, found = typer.Typer(rich_markup_mode=None), []

    @app.command()
    def run(*, system: System = DEFAULT_SYSTEM, types: Types = None, tolerance: Tolerance = None) -> None:
        found.append((system, types, tolerance))

    words = ["-s", "a.toml", "--type", "/a=T", "--type", "/b=U", "--tolerance", "/a:x=1%"]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert CliRunner().invoke(app, [], env={"RIOT_SYSTEM": "b.toml"}).exit_code == 0
    assert found == [(Path("a.toml"), ["/a=T", "/b=U"], ["/a:x=1%"]), (Path("b.toml"), None, None)]
