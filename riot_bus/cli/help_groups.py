"""What `riot` itself takes and shows: its options, and the groups in which `riot --help` lists the commands.

A command of another package names its group by typer's `rich_help_panel`.
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from riot_bus import __version__

START = "Start here"
EXPLAIN = "Find and explain"
BUS = "On the bus"
LOGS = "Logs"
ROBOTS = "Robots and set-up"

_GROUPS = {
    START: "demo init doctor test analyze",
    EXPLAIN: "minimize relevance rules permeability activate reproduce report findings trials compare predict guard "
    "step ci",
    BUS: "router ctl record play graph exec interceptors",
    LOGS: "info show types",
    ROBOTS: "dict",
}
"""The commands of riot itself, in the order of the help."""


class GroupedCommands(TyperGroup):
    """A command whose help lists its commands by groups, each with the first sentence of its help, uncut."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, those of other packages last in their group."""
        there = {name: command for name in self.list_commands(ctx) if (command := self.get_command(ctx, name))}
        groups = {title: [name for name in names.split() if name in there] for title, names in _GROUPS.items()}
        own = {name for names in groups.values() for name in names}
        for name in sorted(there.keys() - own):
            groups.setdefault(getattr(there[name], "rich_help_panel", None) or ROBOTS, []).append(name)
        for title, names in groups.items():
            with formatter.section(title):
                formatter.write_dl([(name, _sentence(there[name].help or "")) for name in names])


def _sentence(text: str) -> str:
    return " ".join(text.split("\n\n")[0].split()).partition(". ")[0].rstrip(".")


def _version(value: bool) -> None:  # noqa: FBT001 - called by typer
    if value:
        typer.echo(f"riot_bus {__version__}")
        raise typer.Exit


def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Robustness Inside-Out Testing on a message bus."""
