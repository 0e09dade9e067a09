"""`riot dict`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import Format, OutputFormat, UnitName
from riot_bus.cli.printing import new_table, print_json, print_lines, print_result, print_table
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.campaign.bindings import AppliesTo
    from riot_bus.inject.dictionary_file import DictionaryFile

_SHOWN = 8
"""Number of fields to name that a table applies to; JSON has all."""

_System = Annotated[
    Path | None,
    typer.Option(
        "--system", "-s", envvar="RIOT_SYSTEM", help="System file; only the inputs of its unit are looked at."
    ),
]
_Log = Annotated[
    Path | None,
    typer.Option(metavar="LOG", help="Log to check the dictionary against. [default: that of the system file]"),
]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(no_args_is_help=True)
    group.command("list")(list_all)
    for command in (show, validate, schema):
        group.command()(command)
    app.add_typer(group, name="dict", help="Dictionaries: the values and mutations that campaigns try.")


def list_all(
    *,
    system: Annotated[
        Path | None,
        typer.Option(
            "--system", "-s", envvar="RIOT_SYSTEM", help="System file whose own dictionaries are listed, too."
        ),
    ] = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """List the dictionaries of all installed packages, and those that a system file names."""
    from riot_bus.chain.steps.dictionaries import list_dictionaries

    found = list_dictionaries(system)
    if form is OutputFormat.JSON:
        print_json([asdict(each) for each in found])
        return
    table = new_table("dictionary", numbers=("values", "fields", "mutations"))
    if system is not None:
        table.add_column("units", overflow="fold")
    rows = []
    for each in found:
        counts = [str(number or "") for number in (each.values, each.fields, each.mutations)]
        rows.append([each.name, *counts, *([", ".join(each.units)] if system is not None else [])])
    print_table(table, rows)


def show(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="A listed dictionary, such as float64, or a file.")],
    *,
    log: _Log = None,
    system: _System = None,
    unit: UnitName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Show the values and mutations of a dictionary and, given a log, the fields in it that they apply to."""
    from riot_bus.chain.steps.dictionaries import find_dictionary, log_to_apply_to, tables_applied

    where = log_to_apply_to(log, system, unit)
    name, text = find_dictionary(name)
    file, found = tables_applied(name, text, where)
    document: dict[str, Any] = {"name": name, "file": file.model_dump(mode="json", exclude_defaults=True)}
    if where is not None:
        document |= {"log": where.name, "applies": {key: asdict(each) for key, each in found.items()}}
    print_result(form, document, [name if where is None else f"{name} beside {where.name}", *_lines(file, found)])


def validate(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="Dictionary file.")],
    *,
    log: _Log = None,
    system: _System = None,
    unit: UnitName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Check a dictionary file and, given a log, what of it can never apply. Exit code 2: something is wrong."""
    from riot_bus.chain.steps.dictionaries import errors_of, log_to_apply_to
    from riot_bus.vocabulary.errors import ConfigError

    where = log_to_apply_to(log, system, unit)
    counted, problems = errors_of(path, where)
    if form is OutputFormat.JSON:
        told = [{"where": each.where, "message": each.message, "hint": each.hint} for each in problems]
        print_json({"file": str(path), "log": where.name if where else None, "errors": told})
    else:
        for each in problems:
            warn("\n".join(map(escape_control_chars, f"riot: {each}".split("\n"))))
        if not problems and counted is not None:
            parts = f"{counted.values} values, {counted.fields} bindings, {counted.mutations} mutations"
            checked = f"all can apply to {where.name}" if where else "not compared with a log (--log, --system)"
            print_lines([f"{path}: {parts}; {checked}"])
    if problems:
        raise typer.Exit(ConfigError.exit_code)


def schema() -> None:
    """Print the JSON Schema of dictionary files."""
    from riot_bus.inject.dictionary_file import json_schema

    print_json(json_schema())


def _lines(file: DictionaryFile, found: dict[str, AppliesTo]) -> list[str]:
    """Return a file as lines, one for each value or mutation; after each table, what it applies to."""
    lines: list[str] = []
    if file.entry:
        values = [(each.type or file.type or "any type", _value(each.value), each.reason) for each in file.entry]
        lines += ["", "values", *_columns(values)]
        lines += sorted({line for at in range(len(file.entry)) for line in _applies(found.get(f"entry[{at}]"))})
    for number, binding in enumerate(file.field):
        kinds = [binding.type or file.type or "", "nothing else" if binding.only else ""]
        told = ", ".join(filter(None, kinds))
        lines += ["", f"field {', '.join(binding.patterns)}" + (f" ({told})" if told else "")]
        lines += _columns([(_value(each.value), each.reason) for each in binding.entries])
        lines += _applies(found.get(f"field[{number}]"))
    for number, message in enumerate(file.message):
        names = message.type if isinstance(message.type, str) else ", ".join(message.type)
        lines += ["", f"message {names}" + (" (on request)" if message.opt_in else "")]
        lines += [f"  consistent: {message.consistent}"] if message.consistent else []
        rows = [
            (", ".join(f"{path} = {_value(value, formula=True)}" for path, value in each.set.items()), each.reason)
            for each in message.mutations
        ]
        lines += [*_columns(rows), *_applies(found.get(f"message[{number}]"))]
    return lines


def _applies(found: AppliesTo | None) -> list[str]:
    if found is None:
        return []
    lines = [f"  -> {_few(found.fields)}"] if found.fields or not found.left_alone else []
    return lines + ([f"  left alone, or nothing to change: {_few(found.left_alone)}"] if found.left_alone else [])


def _few(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return (", ".join(names[:_SHOWN]) or "nothing in this log") + more


def _value(value: Any, *, formula: bool = False) -> str:
    """Return a value roughly as written in the file."""
    if hasattr(value, "times"):
        return f"{value.times} x {_value(value.repeat)}"
    if hasattr(value, "hex") and not isinstance(value, float):
        return f"0x{value.hex}"
    if isinstance(value, bool):
        return str(value).lower()
    return value if formula and isinstance(value, str) else repr(value)


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [min(40, max(len(cell) for cell in column)) for column in zip(*rows, strict=True)]
    return ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
