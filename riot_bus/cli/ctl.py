"""`riot ctl`: look at a running router and change what it does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from riot_bus.cli import ctl_play, ctl_record
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_result
from riot_bus.config.arguments import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Lines = Callable[[Mapping[str, Any]], list[str]]

Endpoint = Annotated[
    str,
    typer.Option("--endpoint", "-e", metavar="ENDPOINT", envvar="RIOT_ENDPOINT", help="Where the router listens."),
]
RouterName = Annotated[
    str | None,
    typer.Option("--router", metavar="NAME", envvar="RIOT_ROUTER", help="The router's name, if several answer."),
]
Cfg = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=VALUE",
        envvar="RIOT_CLIENT_CFG",
        help="A Zenoh setting of this client, such as a certificate; KEY=@FILE for passwords; repeatable.",
    ),
]
Keys = Annotated[list[str], typer.Argument(metavar="KEYEXPR...", help="Key expressions, or ROS names such as /odom.")]


class _Anywhere(TyperGroup):
    """Accepts its own options after its commands' names, too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own = {name for each in self.params if not getattr(each, "is_flag", False) for name in each.opts}
        end = args.index("--") if "--" in args else len(args)
        front, rest, words = [], [], args[:end]
        while words:
            word = words.pop(0)
            if word.partition("=")[0] not in own or ("=" not in word and not words):
                rest.append(word)
            else:
                front += [word] if "=" in word else [word, words.pop(0)]
        return super().parse_args(ctx, [*front, *rest, *args[end:]])


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    ctl = typer.Typer(
        cls=_Anywhere, no_args_is_help=True, rich_markup_mode=None, help="Look at a running router and change it."
    )
    ctl.callback()(connection)
    ctl.command()(status)
    ctl.command()(counts)
    groups: dict[str, tuple[str, dict[str, Callable[..., None]]]] = {
        "intercept": ("Change what is intercepted.", {"add": intercept_add, "remove": intercept_remove}),
        "plan": ("Load or clear the injection plan.", {"load": plan_load, "clear": plan_clear}),
    }
    for name, (text, commands) in groups.items():
        group = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help=text)
        for command, function in commands.items():
            group.command(command)(function)
        ctl.add_typer(group, name=name)
    ctl.add_typer(ctl_record.group(), name="record")
    ctl.add_typer(ctl_play.group(), name="play")
    app.add_typer(ctl, name="ctl")


def connection(
    context: typer.Context, *, endpoint: Endpoint = DEFAULT_ENDPOINT, router: RouterName = None, cfg: Cfg = None
) -> None:
    """Look at a running router and change it. Exit code 4: no router answers."""
    context.obj = (endpoint, router, cfg or ())


def status(context: typer.Context, *, form: Format = OutputFormat.TEXT) -> None:
    """Show segments, components, interceptors and their errors, plan, recording, counts, losses and bypasses."""
    from riot_bus.control.status_text import status_lines

    _ask(context, form, "status", status_lines)


def counts(context: typer.Context, *, form: Format = OutputFormat.TEXT) -> None:
    """Show what has happened to the messages of each topic so far."""
    from riot_bus.control.status_text import counts_lines

    _ask(context, form, "counts", counts_lines)


def intercept_add(context: typer.Context, keys: Keys, *, form: Format = OutputFormat.TEXT) -> None:
    """Intercept more topics; natively routed messages are interrupted, and lost, for about 100 ms."""
    _ask(context, form, "intercept/add", payload=json.dumps({"keys": keys}).encode())


def intercept_remove(context: typer.Context, keys: Keys, *, form: Format = OutputFormat.TEXT) -> None:
    """Stop intercepting these topics."""
    _ask(context, form, "intercept/remove", payload=json.dumps({"keys": keys}).encode())


def plan_load(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(help="The plan; read on this machine and sent to the router.")],
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Replace the injection plan."""
    from riot_bus.control.remote import plan_payload

    payload, parameters = plan_payload(file)
    _ask(context, form, "plan/load", payload=payload, parameters=parameters)


def plan_clear(context: typer.Context, *, form: Format = OutputFormat.TEXT) -> None:
    """Stop injecting: remove the injection plan."""
    _ask(context, form, "plan/clear")


def _ask(
    context: typer.Context,
    form: OutputFormat,
    command: str,
    lines: Lines | None = None,
    *,
    payload: bytes | None = None,
    parameters: str = "",
) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import ask
    from riot_bus.control.status_text import answer_lines

    endpoint, router, cfg = context.obj
    answer = ask(endpoint, router, command, payload, parameters=parameters, config=client_cfg(cfg))
    print_result(form, answer, (lines or answer_lines)(answer))
