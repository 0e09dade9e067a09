"""`riot play`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from riot_bus.cli.ctl import Cfg, Endpoint
from riot_bus.cli.declared import declared, options_of
from riot_bus.cli.options import Format, OutputFormat, Tolerance, ToleranceFile
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.play.options import Expectation, PlayOptions

_CLOCK_HZ = "40"


class PlayCommand(TyperCommand):
    """Takes `--clock` without a number, as `ros2 bag play` does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give `--clock` its default number where none follows."""
        words = list(args)
        for place, word in enumerate(args):
            following = args[place + 1 : place + 2]
            if word == "--clock" and not (following and following[0].replace(".", "", 1).isdecimal()):
                words[place] = f"--clock={_CLOCK_HZ}"
        return super().parse_args(ctx, words)


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command(cls=PlayCommand)(play)


@declared(PlayOptions, before="expect")
@declared(Expectation, before="tolerance")
def play(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="MCAP files, or folders of them; merged by time.")
    ],
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    tolerance: Tolerance = None,
    tolerances: ToleranceFile = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --expect: also write the result as an HTML page.")
    ] = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Play logs to the components of a Zenoh router, with the recorded timing and quality of service.

    ROS 2 bags (MCAP) become topics of rmw_zenoh. On a terminal, keys pause, step, seek and change the speed. Exit code
    1: the answers are not as expected. 3: messages could not be read or published. 4: no router answers. 130:
    interrupted.
    """
    from riot_bus.cli.terminal import foreground_of
    from riot_bus.control.component import client_cfg
    from riot_bus.play.running import run_play
    from riot_bus.vocabulary.errors import INTERRUPTED, ConfigError

    options = options_of(PlayOptions, given, logs=logs, endpoint=endpoint, config=client_cfg(cfg or ()))
    foreground = foreground_of(form, keys=True)
    if "expect" not in given:
        more = given | {"html": html, "tolerance": tolerance, "tolerances": tolerances}
        unfit = [f"--{name.replace('_', '-')}" for name, value in more.items() if value and name != "expect_wait"]
        if unfit:
            raise ConfigError(
                f"{', '.join(unfit)} cannot be used without --expect", hint="name the log to compare with"
            )
        if not run_play(options, foreground):
            raise typer.Exit(INTERRUPTED)
        return
    from riot_bus.plugins import hook

    play_expecting = hook("play_expecting", "riot_bus_logtools")
    given_tolerances = (tolerance or (), tolerances or ())
    if not play_expecting(options, Expectation(**given), foreground, given_tolerances, html, form):
        raise typer.Exit(INTERRUPTED)
