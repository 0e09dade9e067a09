"""`riot import`, and `riot export` into formats of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.help_groups import LOGS
from riot_bus.cli.options import Definitions, Format, OutputFormat
from riot_bus.cli.printing import print_result

if TYPE_CHECKING:
    from riot_bus.log.loss import Loss
    from riot_bus.types.model import Adapter

_TABLES = (".csv", ".parquet")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command("import", rich_help_panel=LOGS)(import_)


def import_(
    file: Annotated[Path, typer.Argument(help="The .tlog file to read.")],
    log: Annotated[Path, typer.Argument(help="The MCAP file to write.")],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace the log if it exists.")] = False,
    msg: Definitions = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Convert a file of another format to a log: a MAVLink telemetry log (.tlog).

    Exit code 3: the file is damaged, and what could be read was written.
    """
    from riot_bus.vocabulary.errors import DataLossError
    from riot_bus_logtools.archives import import_archive

    done = import_archive(file, log, _adapters(msg), force=force)
    document = {"file": str(log), "messages": done.messages, "damage": done.damage}
    print_result(form, document, [f"{log}: {done.messages} messages"])
    if done.damage:
        raise DataLossError(done.damage, where=str(file))


def messages_to_file(
    log: Path,
    out: Path,
    topics: list[str] | None,
    definitions: list[Path] | None,
    span: tuple[int | None, int | None],
    form: OutputFormat,
    *,
    fields: bool,
    force: bool,
    salvage: bool,
) -> Loss:
    """Write a log's messages in a format of other tools, and print that; return what could not be read."""
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_logtools.archives import export_archive

    adapters = _adapters(definitions)
    if out.suffix in _TABLES:
        if fields:
            raise ConfigError("--topics is not for tables", where=str(out), hint="name columns by --field")
        raise ConfigError("no column is wanted", where=str(out), hint="name one: --field /odom:pose.pose.position.x")
    if fields:
        raise ConfigError("--field is for tables", where=str(out), hint="choose messages by --topics")
    done = export_archive(log, out, adapters, topics=topics, start=span[0], end=span[1], force=force, salvage=salvage)
    document = {"file": str(out), "messages": done.messages, "skipped": done.skipped}
    skipped = f", {done.skipped} others skipped" if done.skipped else ""
    print_result(form, document, [f"{out}: {done.messages} messages{skipped}"])
    return done.loss


def _adapters(definitions: list[Path] | None) -> list[Adapter]:
    """Return the adapters with these definitions loaded."""
    from riot_bus.types.registry import TypeRegistry, load_adapters

    adapters = load_adapters()
    TypeRegistry(adapters, definitions=definitions or ())
    return adapters
