"""`riot diff`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.help_groups import LOGS
from riot_bus.cli.options import Format, OutputFormat, Tolerance, ToleranceFile
from riot_bus.cli.printing import print_json, print_lines, print_result
from riot_bus_logtools.comparison.options import Extract

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.control.terminal import Foreground
    from riot_bus.play.options import Expectation, PlayOptions
    from riot_bus_logtools.comparison.result import LogDifference


def register(app: typer.Typer) -> None:
    """Add this module's command."""
    app.command(rich_help_panel=LOGS)(diff)


@declared(Extract, before="timing")
def diff(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="A B", help="Two logs, or more with --propose: MCAP files, or folders of a recording's files."
        ),
    ],
    *,
    tolerance: Tolerance = None,
    tolerances: ToleranceFile = None,
    propose: Annotated[
        bool, typer.Option("--propose", help="Propose tolerances instead, from two or more nominal runs.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="With --propose: file to write. [default: stdout]"),
    ] = None,
    timing: Annotated[
        float | None,
        typer.Option(
            min=0, metavar="SECONDS", help="Also compare timing: messages may come this much earlier or later."
        ),
    ] = None,
    order: Annotated[
        bool, typer.Option("--order", help="Also compare the order of messages of different topics.")
    ] = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the result as an HTML page.")] = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Say whether a system has answered the same in two logs: count, order and values, apart from timing.

    Exit code 1: they differ. 3: they do not, but a log is damaged or incomplete. 5: nothing could be compared.
    """
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_logtools.comparison.compare import Wishes
    from riot_bus_logtools.comparison.opening import compare_logs
    from riot_bus_logtools.comparison.tolerances import tolerances_of

    extract = Extract(**given)
    judging = {"--tolerance": tolerance, "--tolerances": tolerances, "--timing": timing is not None, "--order": order}
    unfit = [name for name, value in ({**judging, "--html": html} if propose else {"--out": out}).items() if value]
    if unfit:
        raise ConfigError(f"{', '.join(unfit)} cannot be used {'with' if propose else 'without'} --propose")
    if propose:
        _propose(logs, out, extract, form)
        return
    if len(logs) != 2:
        raise ConfigError(f"two logs are compared, not {len(logs)}", hint="riot diff A B")
    wishes = Wishes(tolerances=tolerances_of(tolerance or (), tolerances or ()), timing=timing, order=order)
    found = compare_logs(logs[0], logs[1], wishes, extract=extract)
    print_difference(found, html, form)
    found.check_compared()
    end_with(found)


def print_difference(found: LogDifference, html: Path | None, form: OutputFormat, *, event: str = "") -> None:
    """Print the result of a comparison, and write its page; with an event, JSON is one line that names it."""
    if html is not None:
        from riot_bus_logtools.comparison.page import write_diff_page

        write_diff_page(found, html)
    if event and form is OutputFormat.JSON:
        print_json({"event": event, **found.to_json()}, indent=None)
    else:
        print_result(form, found.to_json(), found.lines())


def play_expected(
    options: PlayOptions,
    expectation: Expectation,
    foreground: Foreground,
    tolerances: tuple[Sequence[str], Sequence[Path]],
    html: Path | None,
    form: OutputFormat,
) -> bool:
    """Play logs, and print how the answers differ, which raises Exit; return False if it was interrupted."""
    from riot_bus_logtools.comparison.compare import Wishes
    from riot_bus_logtools.comparison.expectation import play_expecting
    from riot_bus_logtools.comparison.tolerances import tolerances_of

    wishes = Wishes(tolerances=tolerances_of(*tolerances))
    found = play_expecting(options, expectation, foreground, wishes=wishes)
    if found is None:
        return False
    print_difference(found, html, form, event="compared")
    end_with(found)
    return True


def end_with(found: LogDifference) -> None:
    """End with the exit code of a comparison."""
    found.check_whole()
    if not found.same:
        raise typer.Exit(1)


def _propose(logs: list[Path], out: Path | None, extract: Extract, form: OutputFormat) -> None:
    from riot_bus_logtools.comparison.opening import propose_tolerances

    found = propose_tolerances(logs, extract=extract)
    if out is not None:
        found.write(out)
    if form is OutputFormat.JSON:
        print_json(found.to_json())
    elif out is None:
        typer.echo(found.toml(), nl=False)
    else:
        print_lines(found.lines())
    found.check()
