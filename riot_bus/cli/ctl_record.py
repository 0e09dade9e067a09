"""`riot ctl record`: the recording of a running router, or a running `riot record`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_result

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.remote import Kind

RecorderName = Annotated[
    str | None,
    typer.Option(
        "--recorder", metavar="NAME", envvar="RIOT_RECORDER", help="Control this riot record, even if a router answers."
    ),
]
LogPath = Annotated[
    str | None, typer.Argument(metavar="PATH", help="File on the recording machine, in its folder of recordings.")
]


_COMMANDS = {
    "start": (True, False, "Record all that passes, into a new file; a paused riot record goes on."),
    "stop": (False, False, "End the recording."),
    "split": (True, False, "Go on recording in another file; nothing is lost in between."),
    "status": (False, True, "Show what riot record does and what it has lost; for a router, see riot ctl status."),
    "pause": (False, True, "Pause riot record."),
    "resume": (False, True, "Resume riot record after a pause."),
    "dump": (True, True, "Make riot record --ring write what it keeps in memory."),
}
"""Whether a command takes the path of a file, whether it is for `riot record` alone, and its help."""


def group() -> typer.Typer:
    """Return the commands."""
    text = "Control a router's recording, or riot record if no router answers or --recorder names one."
    found = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help=text)
    for name, (takes_path, only, told) in _COMMANDS.items():
        found.command(name, help=told)(_command(name, takes_path=takes_path, only=only))
    return found


def _command(name: str, *, takes_path: bool, only: bool) -> Callable[..., None]:
    def with_path(
        context: typer.Context, path: LogPath = None, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT
    ) -> None:
        _tell(context, recorder, form, name, path=path, only=only)

    def without(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
        _tell(context, recorder, form, name, only=only)

    return with_path if takes_path else without


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
    print_result(form, found, lines(found))
