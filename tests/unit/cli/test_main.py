from __future__ import annotations

from importlib import import_module

import pytest
import typer
from typer.testing import CliRunner

from riot_bus.cli.main import COMMANDS, make_app


@pytest.mark.parametrize("module", COMMANDS)
def test_each_module_has_the_commands_by_which_it_is_found(module: str) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    import_module(f"riot_bus.cli.{module}").register(app)
    assert tuple(typer.main.get_group(app).commands) == COMMANDS[module]


def test_one_command_needs_its_module_alone() -> None:
    everything = typer.main.get_group(make_app()).commands
    assert sorted(everything) == sorted(name for commands in COMMANDS.values() for name in commands)
    assert list(typer.main.get_group(make_app("info")).commands) == ["info", "types", "export"]
    assert list(typer.main.get_group(make_app("--version")).commands) == list(everything)


def test_a_wrong_command_is_answered_as_if_all_were_known() -> None:
    result = CliRunner().invoke(make_app("recrod"), ["recrod"])
    assert result.exit_code == 2
    assert "No such command 'recrod'" in result.output
