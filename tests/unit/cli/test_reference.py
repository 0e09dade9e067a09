"""docs/commands.md is what the command line says of itself: python tests/unit/cli/test_reference.py writes it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any

import typer.main

from riot_bus.cli.main import make_app

PUBLISHED = Path(__file__).parents[3] / "docs/commands.md"
HEAD = """\
# All commands and options

What `riot COMMAND --help` says, on one page; other pages say what each is for. It is written by the code
(`python tests/unit/cli/test_reference.py`), and a test fails where it is not what the code does.
"""
COMPLETION = {"--install-completion", "--show-completion"}
"""Typer's own."""


def commands(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield a command and all below it, in alphabetical order, each with the words by which it is called."""
    yield path, command
    if hasattr(command, "list_commands"):
        context = command.make_context(path, [], resilient_parsing=True)
        for name in sorted(command.list_commands(context)):
            each = command.get_command(context, name)
            if not each.hidden:
                yield from commands(each, f"{path} {name}")


def in_a_row(text: str | None) -> str:
    """Return a text as a cell of a table."""
    return re.sub(r"\s+", " ", text or "").strip().replace("|", "\\|")


def default(option: Any) -> str:
    if isinstance(option.show_default, str):
        return option.show_default
    plain = isinstance(option.default, str | int | float | PurePath) and not isinstance(option.default, bool)
    return str(getattr(option.default, "value", option.default)) if plain and option.show_default else ""


def rows(command: Any) -> Iterator[str]:
    """Yield a row for each argument and option that is no secret."""
    for each in command.params:
        if each.hidden or COMPLETION & set(each.opts):
            continue
        if each.param_type_name == "argument":
            names = f"`{each.metavar or each.name.upper()}`"
        else:
            choices = each.type_descriptor.choices or ()
            allowed = each.metavar or "|".join(str(getattr(choice, "value", choice)) for choice in choices)
            value = f" {allowed}" if allowed else ""
            names = ", ".join(f"`{name}{value}`" for name in (*each.opts, *each.secondary_opts))
        told = in_a_row(each.help) + (f" (default: `{in_a_row(shown)}`)" if (shown := default(each)) else "")
        yield f"| {in_a_row(names)} | {told}{' (required)' if each.required else ''} |"


def text() -> str:
    """Return the page."""
    parts = [HEAD]
    for path, command in commands(typer.main.get_command(make_app(None)), "riot"):
        table = list(rows(command))
        parts.append(f"{'###' if path.count(' ') > 1 else '##'} {path}\n\n{in_a_row(command.help)}\n")
        if table:
            parts.append("\n".join(["| argument or option | meaning |", "|---|---|", *table]) + "\n")
    return "\n".join(parts)


def test_the_reference_is_what_the_command_line_says() -> None:
    assert PUBLISHED.read_text(encoding="utf-8") == text(), f"run: python {Path(__file__)}"


def test_every_command_and_option_says_what_it_is_for() -> None:
    for path, command in commands(typer.main.get_command(make_app(None)), "riot"):
        assert command.help, path
        for each in command.params:
            assert each.hidden or COMPLETION & set(each.opts) or each.help, f"{path}: {each.name}"


if __name__ == "__main__":
    PUBLISHED.write_text(text(), encoding="utf-8")
