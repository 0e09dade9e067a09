"""`riot info`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command()(info)


def info(log: Annotated[Path, typer.Argument(help="An MCAP file.")], *, form: Format = OutputFormat.TEXT) -> None:
    """Say what a log holds: topics, types, counts, duration, and what is missing of a damaged one."""
    import json
    from dataclasses import asdict

    from rich.console import Console
    from rich.table import Table

    from riot_bus.log.info import log_info

    found = log_info(log)
    if form is OutputFormat.JSON:
        typer.echo(json.dumps(asdict(found), indent=1, default=str))
    else:
        table = Table("topic", "type", "messages", "Hz", box=None, header_style="bold", pad_edge=False)
        for topic in found.topics:
            table.add_row(topic.topic, topic.type, str(topic.count), f"{topic.rate:.1f}")
        Console().print(table)
        typer.echo(f"{found.seconds:.3f} s")
    if found.loss:
        from riot_bus.errors import DataLossError

        raise DataLossError(str(found.loss), where=str(log))
