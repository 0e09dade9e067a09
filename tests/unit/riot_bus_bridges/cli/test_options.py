from __future__ import annotations

from functools import partial
from typing import Annotated

import typer
from typer.testing import CliRunner

from riot_bus_bridges.cli.bridge import with_options
from tests.unit.cli.test_declared import Options


def test_a_parameter_of_a_dataclass_is_its_options() -> None:
    app, found = typer.Typer(rich_markup_mode=None), []

    @app.command()
    @partial(with_options, known={"form": Annotated[str, typer.Option("--as")]})
    def command(*, first: int = 0, options: Options, form: str = "text") -> None:
        found.append((first, options, form))

    CliRunner().invoke(app, ["--room", "2k", "--services", "c", "--as", "json", "--first", "1"], catch_exceptions=False)
    assert found == [(1, Options(size=2000, services=["c"]), "json")]
    shown = CliRunner().invoke(app, "--help").output
    places = [shown.index(name) for name in ("--first", "--count", "--loop", "--as")]
    assert places == sorted(places)
