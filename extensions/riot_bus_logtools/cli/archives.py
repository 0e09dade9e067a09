"""`riot import`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.help_groups import LOGS
from riot_bus.cli.options import Definitions, Format, OutputFormat
from riot_bus.cli.printing import print_result

if TYPE_CHECKING:
    from riot_bus.types.model import Adapter


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

    done = import_archive(file, log, adapters_with(msg), force=force)
    document = {"file": str(log), "messages": done.messages, "damage": done.damage}
    print_result(form, document, [f"{log}: {done.messages} messages"])
    if done.damage:
        raise DataLossError(done.damage, where=str(file))


def adapters_with(definitions: list[Path] | None) -> list[Adapter]:
    """Return the adapters with these definitions loaded."""
    from riot_bus.types.registry import TypeRegistry, load_adapters

    adapters = load_adapters()
    TypeRegistry(adapters, definitions=definitions or ())
    return adapters
