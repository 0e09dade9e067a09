"""`riot record`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.ctl import Cfg, Endpoint
from riot_bus.cli.declared import declared
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.record.options import CaptureOptions

_SECRET = ("--cfg", "--fleet-cfg")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command()(record)


@declared(CaptureOptions, before="monitors")
def record(
    keys: Annotated[
        list[str] | None, typer.Argument(metavar="[KEYEXPR...]", help="Key expressions, or ROS names such as /odom.")
    ] = None,
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    all_: Annotated[bool, typer.Option("--all", "-a", help="Record everything, as without any KEYEXPR.")] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.mcap", help="File to write. [default: named by date and time]"),
    ] = None,
    bag: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write a ROS 2 bag: a folder with metadata.yaml; ROS topics only."),
    ] = None,
    monitors: Annotated[
        Path | None,
        typer.Option(metavar="riot.toml", help="Write the ring when one of the [[monitors]] of this file is violated."),
    ] = None,
    note: Annotated[
        list[str] | None, typer.Option(metavar="KEY=TEXT", help="Something else for the log; repeatable.")
    ] = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Record a Zenoh network as MCAP: everything, or what is named; until Ctrl-C.

    On a terminal, keys pause and begin another file. SIGUSR1 writes the ring. Exit code 3: messages are lost; how many
    of each topic and why is said at the end and written into the log. 4: no router answers at the endpoint.
    """
    from riot_bus.cli.terminal import foreground_of
    from riot_bus.control.component import client_cfg
    from riot_bus.record.running import run_capture
    from riot_bus.trial.context import invariants_of
    from riot_bus.vocabulary.errors import ConfigError

    if bag is not None and output is not None:
        raise ConfigError("--bag and --output both say where to", hint="choose one")
    if all_ and keys:
        raise ConfigError("--all and key expressions both say what to record", hint="choose one, or take --exclude")
    options = CaptureOptions(
        endpoint=endpoint,
        config=client_cfg(cfg or ()),
        keys=keys or ("**",),
        output=output if bag is None else bag,
        bag=bag is not None,
        monitors=invariants_of(monitors) if monitors is not None else (),
        notes={**_notes(note or ()), "command": _command(sys.argv)},
        **given,
    )
    run_capture(options, foreground_of(form, keys=True))


def _notes(texts: list[str] | tuple[()]) -> dict[str, str]:
    from riot_bus.vocabulary.errors import ConfigError

    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise ConfigError(f"{text!r} is not a note", where="--note", hint="write KEY=TEXT, such as place='hall 3'")
        found[key] = value
    return found


def _command(words: list[str]) -> str:
    """Return the command line without the values of --cfg, which may be passwords, and configurations of endpoints."""
    import shlex

    from riot_bus.vocabulary.redaction import redacted

    shown, hide = [], False
    for word in words:
        option, equals, value = word.partition("=")
        if hide:
            shown.append(word.partition("=")[0] + "=...")
        elif option in _SECRET and equals:
            shown.append(f"{option}={value.partition('=')[0]}=...")
        else:
            shown.append(redacted(word))
        hide = word in _SECRET
    return shlex.join(["riot", *shown[1:]])
