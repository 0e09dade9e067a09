"""`riot bridge NAME`: joins other middleware to a segment; each NAME is a plug-in (`BRIDGES`)."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from riot_bus.cli.ctl import Cfg
from riot_bus.cli.declared import CommandT, options_of, parameter_of, read_options, shown_as
from riot_bus.cli.help_groups import BUS
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.control.router_flags import RouterOptions
from riot_bus.plugins import PluginKind
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.flags import flags_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from riot_bus.control.terminal import Foreground
    from riot_bus_bridges.bridging import Bridge, LinkedBridge, OwnRouter
    from riot_bus_bridges.host.outer_port import OuterPort


def with_options(command: CommandT, known: Mapping[str, Any]) -> CommandT:
    """Give a command the options of each dataclass that is the type of one of its parameters.

    Args:
        known: Annotations that replace the command's own, by the name of the parameter.
    """
    parameters: list[inspect.Parameter] = []
    kinds: dict[str, type] = {}
    for each in inspect.signature(command, eval_str=True).parameters.values():
        if is_dataclass(each.annotation):
            kinds[each.name] = each.annotation  # type: ignore[assignment]  # no instance
            parameters += [parameter_of(*flag) for flag in flags_of(kinds[each.name])]
        else:
            parameters.append(each.replace(annotation=known.get(each.name, each.annotation)))

    def run(**values: Any) -> None:
        for name, kind in kinds.items():
            values[name] = options_of(kind, read_options(flags_of(kind), values))
        command(**values)

    return shown_as(command, run, parameters)


def annotation_of(kind: type, name: str) -> Any:
    """Return the annotation by which typer knows an option of a dataclass."""
    return next(parameter_of(*each).annotation for each in flags_of(kind) if each[0].name == name)


BRIDGES = PluginKind("bridge", "riot_bus.bridges")

_OURS = {"system": annotation_of(RouterOptions, "system"), "cfg": Cfg, "form": Format}
"""Options of riot itself that a command gets by the names of its parameters."""


class _Bridges(TyperGroup):
    """Finds bridges by name, and imports the module of a command only when it is named or listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all bridges that are installed."""
        del ctx
        return list(BRIDGES.targets())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a bridge's command, None if there is none of this name."""
        del ctx
        return _command(cmd_name) if cmd_name in BRIDGES.targets() else None


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    bridge = typer.Typer(
        cls=_Bridges, help="Join other middleware to a segment.", no_args_is_help=True, rich_markup_mode=None
    )
    bridge.callback()(_hand_over)
    app.add_typer(bridge, name="bridge", rich_help_panel=BUS)


def _hand_over(context: typer.Context) -> None:
    context.obj = BridgeHost()


def _command(name: str) -> Any:
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    try:
        function = BRIDGES.load(name)
    except RiotError as error:  # the others must still be listed
        reason = error

        def fail() -> None:
            raise reason

        anything = {"ignore_unknown_options": True, "allow_extra_args": True}
        app.command(name, help=f"Cannot be loaded: {error.message}", context_settings=anything)(fail)
    else:
        app.command(name)(with_options(function, _OURS))
    return typer.main.get_command(app)


class BridgeHost:
    """Services of riot for the command of a bridge, which does not know Zenoh."""

    def ports(
        self,
        segments: Sequence[str],
        endpoint: str | None = None,
        *,
        system: Path | None = None,
        cfg: Sequence[str] = (),
    ) -> dict[str, AbstractContextManager[Any]]:
        """Return ports of segments by name, which exchange bytes and connect when they are entered.

        Args:
            segments: Segments as `NAME=ENDPOINT`; `NAME` for one of riot.toml, or of a router without riot.toml.
            endpoint: Endpoint of the only segment, which has no name then, instead of `segments`.
            system: Path of riot.toml; None for the one in the working folder, if there is one.
            cfg: Further Zenoh settings, as `KEY=VALUE`.

        Raises:
            ConfigError: There is no such segment, both or neither are given, or a setting is wrong.
        """
        from riot_bus.control.component import client_cfg, segment_access

        own = client_cfg(cfg)
        found: dict[str, AbstractContextManager[Any]] = {}
        for name, place in _places(segments, endpoint).items():
            if place is None:
                endpoints, config, _ = segment_access(name, RouterOptions(system=system), own)
            else:
                endpoints, config = [place], own
            found[name] = _port(endpoints, config)
        return found

    def run(self, bridge: Bridge, *, program: Sequence[str] = (), as_json: bool = False) -> int:
        """Bridge until SIGINT, SIGTERM, a failure, or the end of the program behind the bridge; print what crossed.

        Args:
            bridge: The bridge; it is started and ended here.
            program: Command and arguments of the program; empty for none; `{WORD}` is replaced using `bridge.words()`.
            as_json: Whether to print lines of JSON.

        Returns:
            The program's exit status, 0 if it was still running or there is none; a signal that ended it ends this
            process, too.

        Raises:
            RiotError: The bridge does not start, or has failed.
        """
        from riot_bus_bridges.host.running import end_as, run_bridge

        return end_as(run_bridge(bridge, _foreground(as_json=as_json), program))

    def segments(self, asked: OwnRouter) -> list[str]:
        """Return the names of the segments that a router would have.

        Raises:
            ConfigError: The system file or an option is wrong.
        """
        from riot_bus.control.router_options import settings_of

        return list(settings_of(RouterOptions(**asdict(asked))).segments)

    def run_router(
        self,
        bridge_of: Callable[[Mapping[str, Any]], LinkedBridge],
        asked: OwnRouter,
        *,
        program: Sequence[str] = (),
        as_json: bool = False,
    ) -> int:
        """Route and bridge in one process, until the same events as `run`.

        Returns:
            The same exit status as `run`.

        Raises:
            RiotError: The bridge does not start or has failed, or messages were lost.
        """
        from riot_bus_bridges.host.running import end_as, run_own_router

        options = RouterOptions(**asdict(asked))
        return end_as(run_own_router(options, bridge_of, _foreground(as_json=as_json), program))


def _places(texts: Sequence[str], endpoint: str | None) -> dict[str, str | None]:
    """Return the endpoints of segments by name, None for those given by name only."""
    if bool(texts) == (endpoint is not None):
        hint = "give --segment NAME or --endpoint ENDPOINT, not both"
        raise ConfigError("which segment?", where="riot bridge", hint=hint)
    places: dict[str, str | None] = {}
    for text in texts or [f"={endpoint}"]:
        name, equals, place = text.partition("=")
        if name in places:
            raise ConfigError(f"segment {name!r} is named twice", where="--segment")
        places[name] = place if equals else None
    return places


@contextmanager
def _port(endpoints: Sequence[str], config: Mapping[str, Any]) -> Iterator[OuterPort]:
    from riot_bus.zenoh.segment_port import open_port
    from riot_bus_bridges.host.outer_port import OuterPort

    with open_port(OuterPort, endpoints, config=config) as port:
        yield port


def _foreground(*, as_json: bool) -> Foreground:
    from riot_bus.cli.terminal import foreground_of

    return foreground_of(OutputFormat.JSON if as_json else OutputFormat.TEXT)
