"""`riot ctl`: look at a running router and change what it does; `riot graph`: who talks to whom there."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_result
from riot_bus.config.arguments import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.control.remote import Kind

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
PlayerName = Annotated[
    str | None,
    typer.Option("--player", metavar="NAME", envvar="RIOT_PLAYER", help="The player's name, if several answer."),
]
RecorderName = Annotated[
    str | None,
    typer.Option(
        "--recorder", metavar="NAME", envvar="RIOT_RECORDER", help="Control this riot record, even if a router answers."
    ),
]
LogPath = Annotated[
    str | None, typer.Argument(metavar="PATH", help="File on the recording machine, in its folder of recordings.")
]

_OF_PLAYER = {
    "status": "Show where the player is, and how late its messages are.",
    "pause": "Pause playing.",
    "resume": "Go on playing after a pause.",
    "stop": "Stop playing.",
}
"""Commands to a player that take no arguments, and their help."""

_OF_RECORDER = {
    "start": (True, False, "Record all that passes, into a new file; a paused riot record goes on."),
    "stop": (False, False, "End the recording."),
    "split": (True, False, "Go on recording in another file; nothing is lost in between."),
    "status": (False, True, "Show what riot record does and what it has lost; for a router, see riot ctl status."),
    "pause": (False, True, "Pause riot record."),
    "resume": (False, True, "Resume riot record after a pause."),
    "dump": (True, True, "Make riot record --ring write what it keeps in memory."),
}
"""Whether a command takes the path of a file, whether it is for `riot record` alone, and its help."""


class GraphFormat(StrEnum):
    """How a graph is written to stdout."""

    TEXT = "text"
    JSON = "json"
    MERMAID = "mermaid"
    DOT = "dot"


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
    intercept = _group(ctl, "intercept", "Change what is intercepted.")
    intercept.command("add")(intercept_add)
    intercept.command("remove")(intercept_remove)
    plan = _group(ctl, "plan", "Load or clear the injection plan.")
    plan.command("load")(plan_load)
    plan.command("clear")(plan_clear)
    text = "Control a router's recording, or riot record if no router answers or --recorder names one."
    record = _group(ctl, "record", text)
    for name, (takes_path, only, told) in _OF_RECORDER.items():
        record.command(name, help=told)(_recorder_command(name, takes_path=takes_path, only=only))
    play = _group(ctl, "play", "Control a running player.")
    for name, told in _OF_PLAYER.items():
        play.command(name, help=told)(_player_command(name))
    for each in (step, seek, rate):
        play.command()(each)
    app.add_typer(ctl, name="ctl")
    app.command()(graph)


def _group(above: typer.Typer, name: str, text: str) -> typer.Typer:
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help=text)
    above.add_typer(group, name=name)
    return group


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


def _recorder_command(name: str, *, takes_path: bool, only: bool) -> Callable[..., None]:
    def with_path(
        context: typer.Context, path: LogPath = None, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT
    ) -> None:
        _ask_recorder(context, recorder, form, name, path=path, only=only)

    def without(context: typer.Context, *, recorder: RecorderName = None, form: Format = OutputFormat.TEXT) -> None:
        _ask_recorder(context, recorder, form, name, only=only)

    return with_path if takes_path else without


def _player_command(name: str) -> Callable[..., None]:
    def command(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
        _ask_player(context, player, form, name)

    return command


def step(
    context: typer.Context,
    count: Annotated[int, typer.Argument(min=1, help="Number of messages.")] = 1,
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Publish the next messages at once, then pause."""
    _ask_player(context, player, form, "step", count=count)


def seek(
    context: typer.Context,
    time: Annotated[float, typer.Argument(metavar="SECONDS", help="Time since the beginning of the logs.")],
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Go on playing from another time."""
    _ask_player(context, player, form, "seek", time=time)


def rate(
    context: typer.Context,
    speed: Annotated[float, typer.Argument(metavar="RATE", help="1: as recorded; 0: as fast as possible.")],
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Go on playing at another speed."""
    _ask_player(context, player, form, "rate", rate=speed)


def _ask_player(
    context: typer.Context, player: str | None, form: OutputFormat, command: str, **arguments: float
) -> None:
    from riot_bus.play.text import status_lines

    payload = json.dumps(arguments).encode()
    _ask(context, form, f"play/{command}", status_lines, payload=payload, whom=(player, "player"))


def _ask_recorder(
    context: typer.Context,
    recorder: str | None,
    form: OutputFormat,
    command: str,
    *,
    path: str | None = None,
    only: bool,
) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import find_routers
    from riot_bus.record.text import answer_lines

    endpoint, router, cfg = context.obj
    payload = json.dumps({} if path is None else {"path": path}).encode()
    if recorder is None and not only and (router is not None or find_routers(endpoint, config=client_cfg(cfg))):
        _ask(context, form, f"record/{command}", payload=payload)
    else:
        _ask(context, form, f"record/{command}", answer_lines, payload=payload, whom=(recorder, "recorder"))


def _ask(
    context: typer.Context,
    form: OutputFormat,
    command: str,
    lines: Lines | None = None,
    *,
    payload: bytes | None = None,
    parameters: str = "",
    whom: tuple[str | None, Kind] | None = None,
) -> None:
    """Send a command to the router, or to whom is named, and print the answer."""
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import ask
    from riot_bus.control.status_text import answer_lines

    endpoint, router, cfg = context.obj
    name, kind = whom or (router, "router")
    answer = ask(endpoint, name, command, payload, parameters=parameters, config=client_cfg(cfg), kind=kind)
    print_result(form, answer, (lines or answer_lines)(answer))


def graph(
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    router: RouterName = None,
    cfg: Cfg = None,
    form: Annotated[
        GraphFormat, typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout.")
    ] = GraphFormat.TEXT,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Print each change until Ctrl-C.")] = False,
) -> None:
    """Show who talks to whom in the segments of a running router, and what is not known."""
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import Remote, graphs
    from riot_bus.graph.render import render

    with Remote(endpoint, router, config=client_cfg(cfg or ())) as remote:
        for found in graphs(remote, watch=watch):
            typer.echo(render(found, form.value, indent=None if watch else 1).rstrip("\n"))
