from __future__ import annotations

import inspect
from typing import Any

import typer
from click.testing import Result
from typer.testing import CliRunner

from riot_bus.cli.declared import declared
from riot_bus.cli.init import init
from riot_bus.draft.init_options import InitOptions
from riot_bus.vocabulary.flags import flags_of


def run(*words: str) -> Result:
    app = typer.Typer(rich_markup_mode=None)

    def command(**given: Any) -> None:
        typer.echo(InitOptions(**given))

    app.command()(declared(InitOptions)(command))
    return CliRunner().invoke(app, words)


def test_riot_init_has_all_of_them() -> None:
    assert {field.name for field, _, _ in flags_of(InitOptions)} <= inspect.signature(init).parameters.keys()


def test_without_arguments_they_are_the_defaults() -> None:
    assert run().output.strip() == str(InitOptions())


def test_how_long_to_look_is_bounded() -> None:
    assert (run("--seconds=600").exit_code, run("--seconds=601").exit_code, run("--seconds=0").exit_code) == (0, 2, 2)
    assert "0.1<=x<=600" in run("--help").output
