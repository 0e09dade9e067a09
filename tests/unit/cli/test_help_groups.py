from __future__ import annotations

import typer
from typer.testing import CliRunner

from riot_bus import __version__
from riot_bus.cli import help_groups
from riot_bus.cli.help_groups import BUS, LOGS, GroupedCommands, options
from riot_bus.cli.main import COMMANDS

ONE_EACH = {"dict": "Dict", "info": "Info", "router": "Router", "findings": "Findings", "demo": "Demo"}
"""A command of each group, in another order than theirs."""


def app(**helps: str) -> typer.Typer:
    """Return an application with commands and their help."""
    made = typer.Typer(cls=GroupedCommands, rich_markup_mode=None)
    made.callback()(options)
    for name, text in (ONE_EACH | helps).items():
        made.command(
            name, help=text, rich_help_panel=LOGS if name == "export" else "Drones" if name == "fly" else None
        )(lambda: None)
    return made


def shown(**helps: str) -> dict[str, list[str]]:
    """Return the lines of the help below each title."""
    groups: dict[str, list[str]] = {}
    for line in CliRunner().invoke(app(**helps), ["--help"], env={"COLUMNS": "200"}).output.splitlines():
        if line.endswith(":"):
            groups[line[:-1]] = []
        elif line.startswith("  ") and groups:
            groups[[*groups][-1]].append(line.split()[0])
    return groups


def test_every_command_is_in_one_group() -> None:
    grouped = [name for names in help_groups._GROUPS.values() for name in names.split()]
    assert sorted(grouped) == sorted(name for names in COMMANDS.values() for name in names)


def test_commands_are_shown_in_the_order_of_the_groups() -> None:
    found = shown(play="Play", compare="Compare")
    assert [*found][-5:] == ["Start here", "Find and explain", BUS, LOGS, "Robots and set-up"]
    assert found["Find and explain"] == ["findings", "compare"]
    assert found[BUS] == ["router", "play"]


def test_commands_of_other_packages_come_last_in_the_group_that_they_name() -> None:
    found = shown(export="Export", zebra="Zebra", fly="Fly")
    assert found[LOGS] == ["info", "export"]
    assert found["Robots and set-up"] == ["dict", "zebra"]
    assert found["Drones"] == ["fly"]


def test_of_a_help_only_the_first_sentence_is_shown_uncut() -> None:
    assert help_groups._sentence("Do it\n  now, e.g.this. And more.\n\nEven more.") == "Do it now, e.g.this"
    assert help_groups._sentence("Do it.") == "Do it"
    assert help_groups._sentence("") == ""
    long = " ".join(["word"] * 40)
    output = CliRunner().invoke(app(info=f"{long}. Not this."), ["--help"], env={"COLUMNS": "80"}).output
    assert " ".join(output.split()).count("word") == 40
    assert "Not this" not in output


def test_the_version_ends_the_command() -> None:
    result = CliRunner().invoke(app(), ["--version", "info"])
    assert (result.output, result.exit_code) == (f"riot_bus {__version__}\n", 0)
