"""What several commands of a fleet share: the option that names the catalogue, and progress on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.events import StepProgress, StepStarted

CatalogueFile = Annotated[
    Path | None,
    typer.Option(
        "--catalogue",
        metavar="FILE",
        envvar="RIOT_CATALOGUE",
        help="The catalogue. [default: riot/catalogue.sqlite in $XDG_DATA_HOME]",
    ),
]


@contextmanager
def step_progress(step: str) -> Iterator[Callable[[int, int | None, str], None]]:
    """Show the progress of one step on stderr; yield a function of the parts done, of all, and the current work."""
    from rich.console import Console

    from riot_bus.cli.narrate import ConsoleNarrator

    with ConsoleNarrator(Console(stderr=True)) as narrator:
        narrator(StepStarted(step))
        yield lambda done, total, note: narrator(StepProgress(step, done, total, note))
