"""`riot ctl record`: the recording of a running router, or a running `riot record`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat

if TYPE_CHECKING:
    from riot_bus.control.remote import Kind

__all__ = ["group"]

RecorderName = Annotated[
    str | None,
    typer.Option(
        "--recorder", metavar="NAME", envvar="RIOT_RECORDER", help="Control this riot record, even if a router answers."
    ),
]
LogPath = Annotated[
    str | None, typer.Argument(metavar="PATH", help="File on the recording machine, in its folder of recordings.")
]


def group() -> typer.Typer:
    """Return the commands."""
    text = "Control a router's recording, or riot record if no router answers or --recorder names one."
    found = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help=text)
    for each in (start, stop, split, status, pause, resume, dump):
        found.command()(each)
    return found


def start(
    context: typer.Context, path: LogPath = None, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT
) -> None:
    """Record all that passes, into a new file; a paused riot record goes on."""
    _tell(context, recorder, form, "start", path=path)


def stop(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
    """End the recording."""
    _tell(context, recorder, form, "stop")


def split(
    context: typer.Context, path: LogPath = None, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT
) -> None:
    """Go on recording in another file; nothing is lost in between."""
    _tell(context, recorder, form, "split", path=path)


def status(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
    """Show what riot record does and what it has lost; for a router's recording see riot ctl status."""
    _tell(context, recorder, form, "status", only=True)


def pause(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
    """Pause riot record."""
    _tell(context, recorder, form, "pause", only=True)


def resume(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
    """Resume riot record after a pause."""
    _tell(context, recorder, form, "resume", only=True)


def dump(
    context: typer.Context, path: LogPath = None, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT
) -> None:
    """Make riot record --ring write what it keeps in memory."""
    _tell(context, recorder, form, "dump", only=True, path=path)


def _tell(
    context: typer.Context,
    recorder: str | None,
    form: OutputFormat,
    command: str,
    *,
    path: str | None = None,
    only: bool = False,
) -> None:
    from riot_bus.control import status_text
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import ask, find_routers
    from riot_bus.record import text

    endpoint, router, cfg = context.obj
    config = client_cfg(cfg)
    routed = recorder is None and not only and (router is not None or bool(find_routers(endpoint, config=config)))
    payload = json.dumps({} if path is None else {"path": path}).encode()
    kind: Kind = "router" if routed else "recorder"
    found = ask(endpoint, router if routed else recorder, f"record/{command}", payload, config=config, kind=kind)
    lines = status_text.answer_lines if routed else text.answer_lines
    typer.echo(json.dumps(found, indent=1) if form is OutputFormat.JSON else "\n".join(lines(found)))
