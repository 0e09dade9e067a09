"""`riot exec`: runs a command in a segment, unchanged."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.fastpath import warn
from riot_bus.cli.router import ComponentCfg, Host


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command("exec", context_settings={"allow_interspersed_args": False})(execute)


def execute(
    command: Annotated[list[str], typer.Argument(metavar="COMMAND", help="What to run.")],
    *,
    segment: Annotated[
        str,
        typer.Option(
            metavar="NAME[=ENDPOINT,...]",
            help="Name of the segment, optionally with where it listens.",
            show_default=False,
        ),
    ],
    host: Host = None,
    cfg: ComponentCfg = None,
    system: Annotated[
        Path | None,
        typer.Option(
            "--system", "-s", metavar="FILE", help="System file that has the segment, also inside riot ros-test."
        ),
    ] = None,
) -> None:
    """Run a command in a segment, in place of this process and with its streams.

    The segment is one of the router that runs this (riot ros-test), else one that riot router would have here.
    It also works as a prefix: ros2 launch ... launch-prefix:='riot exec --segment unit --'
    """
    from riot_bus.control.segment_exec import become, environment_in

    environ = environment_in(
        segment,
        os.environ,
        system=system,
        host=host,
        cfg=cfg or (),
        hint=lambda text: warn(f"hint: {text}"),
    )
    become(command, environ)
