"""`riot edit`."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.fastpath import warn
from riot_bus.cli.help_groups import LOGS
from riot_bus.cli.options import Format, OutputFormat, Types
from riot_bus.cli.printing import new_table, print_json, print_table
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus_logtools.editing.options import EditOptions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus_logtools.editing.result import EditResult


def register(app: typer.Typer) -> None:
    """Add this module's command."""
    app.command(rich_help_panel=LOGS)(edit)


@declared(EditOptions, before="inject")
def edit(
    inputs: Annotated[
        list[Path], typer.Argument(metavar="IN...", help="MCAP files or ROS 2 bag folders; several are merged by time.")
    ],
    output: Annotated[
        Path, typer.Argument(metavar="OUT", help="A file that ends in .mcap, or the folder of a ROS 2 bag.")
    ],
    *,
    inject: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.toml", help="File with values and faults to inject, after the interceptors."),
    ] = None,
    type_: Types = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Make a new log from one or several: cut, drop, change, rename, merge, split, compress, recover.

    Messages that are not touched keep their bytes. Options take effect in this order: --start and --end, --keep,
    --drop, --set, --interceptor, --inject, --shift, --remap; all of them name topics as the input does. Exit code 3:
    the input is damaged; what can be read is written all the same.
    """
    from riot_bus.cli.narrate import bar
    from riot_bus.config.arguments import parse_types
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.interceptors.parsing import build_all
    from riot_bus_logtools.editing.edit import edit as edit_logs

    interceptors = build_all(given.get("interceptors", ()), seed=given["seed"])
    plan = None if inject is None else InjectionPlan.read(inject, seed=given["seed"])
    options = EditOptions(
        inputs=inputs,
        output=output,
        plan=plan.text if plan is not None else None,
        types=parse_types(type_ or ()),
        **given,
    )
    with _ended_by_sigterm(), bar("editing") as progress:
        result = edit_logs(
            options,
            interceptors=[*interceptors, *([plan.injector] if plan is not None else [])],
            progress=progress,
        )
    _tell(result, form, dry=options.dry_run)


def _tell(result: EditResult, form: OutputFormat, *, dry: bool) -> None:
    """Print the result; raises DataLossError if something is missing."""
    from riot_bus.config.arguments import size_text
    from riot_bus.vocabulary.errors import DataLossError

    if form is OutputFormat.JSON:
        print_json(result.document())
    else:
        _table(result)
        for file in result.files:
            typer.echo(f"{file.path}: {file.messages} messages, {size_text(file.size)}")
        if dry:
            typer.echo("nothing is written")
    for warning in result.warnings:
        warn(escape_control_chars(f"warning: {warning}"))
    problems = [f"{path}: {loss}" for path, loss in result.losses.items()]
    if result.unwritable:
        parts = ", ".join(f"{topic} {count}" for topic, count in list(result.unwritable.items())[:5])
        problems.append(f"times that do not fit into a log: {parts}")
    if problems:
        raise DataLossError("; ".join(problems), hint=result.hint)


def _table(result: EditResult) -> None:
    total = result.total()
    columns = ["kept", "changed", "dropped", *(["added"] if total.added else [])]
    columns += ["originals"] if total.originals else []
    table = new_table("topic", numbers=columns)
    renamed = any(each.written_as not in ("", each.topic) for each in result.topics)
    if renamed:
        table.add_column("written as", overflow="fold")
    rows = []
    for each in result.topics:
        written_as = [each.written_as if each.written_as != each.topic else ""] if renamed else []
        rows.append([each.topic, *(str(getattr(each, name)) for name in columns), *written_as])
    print_table(table, rows)


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Let SIGTERM end the work as Ctrl-C does, so that no unfinished file is left behind."""
    import signal

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    former = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)
