"""`riot export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.fastpath import warn
from riot_bus.cli.help_groups import LOGS
from riot_bus.cli.logs import end_with_loss, file_of, registry_of
from riot_bus.cli.options import Definitions, Format, OutputFormat, Salvage, Types
from riot_bus.cli.printing import print_result
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus_logtools.cli.archives import adapters_with


def register(app: typer.Typer) -> None:
    """Add this module's command."""
    app.command(rich_help_panel=LOGS)(export)


def export(
    log: Annotated[Path, typer.Argument(help="An MCAP file, or a folder with one.")],
    *,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="File to write: .csv or .parquet, or .tlog for messages."),
    ],
    field: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC:FIELD", help="A column, such as '/odom:pose.pose.position.x'; repeatable."),
    ] = None,
    topics: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="With .tlog: these topics alone; repeatable.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin there: seconds from the beginning, or a date and time.")
    ] = None,
    end: Annotated[str | None, typer.Option(metavar="TIME", help="End there, likewise; exclusive.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    raw: Annotated[
        bool, typer.Option("--raw", help="CSV: write texts as they are, even if a spreadsheet takes them for formulas.")
    ] = False,
    salvage: Salvage = False,
    type_: Types = None,
    msg: Definitions = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Write fields of a log as a table, one row per message; or its messages as a MAVLink .tlog file.

    Exit code 3: the log is damaged, and what could be read was written.
    """
    from riot_bus.log.naming import parse_time
    from riot_bus.log.reader import LogReader
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_logtools.archives import export_archive
    from riot_bus_logtools.export.export import export_table

    log = file_of(log)
    with LogReader(log, salvage=salvage) as reader:
        registry = registry_of(reader, type_, msg)
        begin = (reader.span() or (0, 0))[0] if start is not None or end is not None else 0
    first = None if start is None else parse_time(start, begin, where="--start")
    last = None if end is None else parse_time(end, begin, where="--end")
    if field is None or topics is not None:
        adapters = adapters_with(msg)
        if out.suffix in (".csv", ".parquet"):
            if field is not None:
                raise ConfigError("--topics is not for tables", where=str(out), hint="name columns by --field")
            raise ConfigError(
                "no column is wanted", where=str(out), hint="name one: --field /odom:pose.pose.position.x"
            )
        if field is not None:
            raise ConfigError("--field is for tables", where=str(out), hint="choose messages by --topics")
        told = export_archive(log, out, adapters, topics=topics, start=first, end=last, force=force, salvage=salvage)
        skipped = f", {told.skipped} others skipped" if told.skipped else ""
        document = {"file": str(out), "messages": told.messages, "skipped": told.skipped}
        print_result(form, document, [f"{out}: {told.messages} messages{skipped}"])
        end_with_loss(told.loss, None, log)
        return
    done = export_table(
        log, field, out, start=first, end=last, force=force, registry=registry, salvage=salvage, raw=raw
    )
    document = {"file": str(out), "rows": done.rows, "values": done.values}
    print_result(form, document, [f"{out}: {done.rows} rows"])
    for name, count in done.values.items():
        if not count:
            warn(f"riot: no message has a value of {escape_control_chars(name)}")
    end_with_loss(done.loss, None, log)
