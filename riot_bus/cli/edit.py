"""`riot edit`."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.options import Definitions, Format, OutputFormat, Salvage, Types
from riot_bus.cli.printing import new_table, print_json, print_table, warn
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.log.editing.result import EditResult

__all__ = ["edit"]


def edit(
    inputs: Annotated[
        list[Path], typer.Argument(metavar="IN...", help="MCAP files or ROS 2 bag folders; several are merged by time.")
    ],
    output: Annotated[
        Path, typer.Argument(metavar="OUT", help="A file that ends in .mcap, or the folder of a ROS 2 bag.")
    ],
    *,
    start: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin there: seconds from the beginning, or a date and time.")
    ] = None,
    end: Annotated[str | None, typer.Option(metavar="TIME", help="End there; likewise.")] = None,
    duration: Annotated[
        str | None, typer.Option(metavar="TIME", help="Keep only this much, such as 90, 90s or 5min.")
    ] = None,
    latched: Annotated[
        bool, typer.Option("--latched", help="Begin with the last messages of latched topics before --start.")
    ] = False,
    align: Annotated[bool, typer.Option("--align", help="Let all inputs begin at the same time.")] = False,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep",
            "--topics",
            metavar="'TOPIC [during A..B] [index I..J] [every N] [where PREDICATE]'",
            help="Keep these messages only; repeatable.",
        ),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option("--drop", "--exclude", metavar="'TOPIC ...'", help="Leave out these; as for --keep; repeatable."),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="'TOPIC:FIELD = VALUE ...'",
            help="Set a field, or change it with += -= *= /=; conditions as for --keep may follow; repeatable.",
        ),
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME key=value ...'|FILE.py[:NAME]",
            help="A shipped interceptor, or your own class; repeatable, carried out in this order.",
        ),
    ] = None,
    inject: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", help="Injections, after the interceptors.")
    ] = None,
    shift: Annotated[
        list[str] | None, typer.Option(metavar="[TOPIC=]SECONDS", help="Move messages in time; repeatable.")
    ] = None,
    remap: Annotated[
        list[str] | None,
        typer.Option("--remap", "-m", metavar="OLD:=NEW", help="Rename a topic, or all below it: '/a/**:=/b/**'."),
    ] = None,
    originals: Annotated[
        bool, typer.Option("--originals/--no-originals", help="Also keep messages as they were before interceptors.")
    ] = True,
    salvage: Salvage = False,
    sort: Annotated[bool, typer.Option("--sort", help="Write by time, even if the input is in another order.")] = False,
    compression: Annotated[
        str | None, typer.Option(metavar="zstd|lz4|none", help="Compression of the output. [default: as the input]")
    ] = None,
    chunk_size: Annotated[str, typer.Option(metavar="SIZE", help="Size of a chunk before compression.")] = "1MiB",
    split_size: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Begin another file at this size, such as 1GB.")
    ] = None,
    split_duration: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin another file after this much of the log's time.")
    ] = None,
    split_topics: Annotated[bool, typer.Option("--split-topics", help="Write a file for each topic.")] = False,
    type_: Types = None,
    msg: Definitions = None,
    seed: Annotated[int, typer.Option(envvar="RIOT_SEED", help="Seed of everything that is random.")] = 0,
    force: Annotated[bool, typer.Option("--force", "-f", help="Replace the output if it exists.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="Write nothing; say what would be kept.")] = False,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Make a new log from one or several: cut, drop, change, rename, merge, split, compress, recover.

    Messages that are not touched keep their bytes. Options take effect in this order: --start and --end, --keep,
    --drop, --set, --interceptor, --inject, --shift, --remap; all of them name topics as the input does. Exit code 3:
    the input is damaged; what can be read is written all the same.
    """
    from riot_bus.cli.narrate import bar
    from riot_bus.config.arguments import parse_seconds, parse_size, parse_types
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.interceptors.parsing import build_all
    from riot_bus.log.editing.edit import edit as edit_logs
    from riot_bus.log.editing.options import EditOptions

    interceptors = build_all(interceptor or (), seed=seed)
    plan = None if inject is None else InjectionPlan.read(inject, seed=seed)
    options = EditOptions(
        inputs=inputs,
        output=output,
        start=start,
        end=end,
        duration=parse_seconds(duration, "--duration") if duration is not None else None,
        latched=latched,
        align=align,
        keep=keep or (),
        drop=drop or (),
        changes=change or (),
        interceptors=interceptor or (),
        plan=plan.text if plan is not None else None,
        seed=seed,
        shifts=shift or (),
        remap=remap or (),
        originals=originals,
        salvage=salvage,
        sort=sort,
        compression=compression,
        chunk_bytes=parse_size(chunk_size, "--chunk-size"),
        split_seconds=parse_seconds(split_duration, "--split-duration") if split_duration is not None else None,
        split_bytes=parse_size(split_size, "--split-size") if split_size is not None else None,
        split_topics=split_topics,
        types=parse_types(type_ or ()),
        definitions=msg or (),
        force=force,
        dry_run=dry_run,
    )
    with _ended_by_sigterm(), bar("editing") as progress:
        result = edit_logs(
            options,
            interceptors=[*interceptors, *([plan.injector] if plan is not None else [])],
            progress=progress,
        )
    _tell(result, form, dry=dry_run)


def _tell(result: EditResult, form: OutputFormat, *, dry: bool) -> None:
    """Print the result; raises DataLossError if something is missing."""
    from riot_bus.log.text import size_text
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
