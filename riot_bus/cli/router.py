"""`riot router`: a drop-in Zenoh router that intercepts what flows between its segments; `router env`; `exec`."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.fastpath import start_router, warn
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.control.router_flags import RouterOptions

Host = Annotated[str | None, typer.Option(help="The router's machine, for components on another one.")]
ComponentCfg = Annotated[
    list[str] | None,
    typer.Option(metavar="KEY=VALUE", help="A Zenoh setting of the component; KEY=@FILE for passwords; repeatable."),
]


class FlavourName(StrEnum):
    """The kind of program that reads an environment."""

    RMW_ZENOH = "rmw_zenoh"
    ZENOH = "zenoh"


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(rich_markup_mode=None)
    group.callback(invoke_without_command=True)(router)
    group.command("env")(env)
    app.add_typer(group, name="router")
    app.command("exec", context_settings={"allow_interspersed_args": False})(execute)


@declared(RouterOptions)
def router(
    context: typer.Context,
    *,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Route messages between segments and intercept some of them, until Ctrl-C.

    Components connect to their segment's endpoint as to any Zenoh router; nothing else changes for them. When it ends,
    it prints what happened to each topic. Exit code 3: messages were lost. 4: an endpoint is in use.
    """
    if context.invoked_subcommand is not None:
        return
    start_router(given, as_json=form is OutputFormat.JSON)


@declared(RouterOptions, "system", "segments")
def env(
    segment_name: Annotated[str, typer.Argument(metavar="SEGMENT", help="The segment that the component is to use.")],
    *,
    flavour: Annotated[
        FlavourName, typer.Option(help="For ROS 2 nodes, or for programs that use Zenoh directly.")
    ] = FlavourName.RMW_ZENOH,
    host: Host = None,
    cfg: ComponentCfg = None,
    file: Annotated[
        Path | None, typer.Option(help="For zenoh: the file to write. [default: zenoh-SEGMENT.json5]")
    ] = None,
    **given: Any,
) -> None:
    """Print what makes a component use a segment, for eval "$(...)"."""
    from riot_bus.control.component import component_environment

    lines, hints = component_environment(
        segment_name, flavour.value, RouterOptions(**given), host=host, cfg=cfg or (), file=file
    )
    for hint in hints:
        typer.echo(f"hint: {hint}", err=True)
    typer.echo("\n".join(lines))


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
