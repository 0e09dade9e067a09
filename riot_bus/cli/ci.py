"""`riot ci`: what a build does with riot."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import DEFAULT_SYSTEM, RunOptions, StreamFormat, System
from riot_bus.cli.printing import print_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager

    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.ci.ci import CiResult
    from riot_bus.findings.known import KnownFindings

DEFAULT_BASELINE = Path("riot-baseline.json")

Units = Annotated[
    list[str] | None,
    typer.Option("--unit", "-u", help="Unit to test; may be repeated. [default: all]", show_default=False),
]
Baseline = Annotated[
    Path, typer.Option("--baseline", "-b", envvar="RIOT_BASELINE", help="File that lists the known findings.")
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Exit 4 if something was not tested, 5 if something is inconclusive.")
]
Trials = Annotated[
    int | None,
    typer.Option(
        "--trials", "-n", min=1, help="Injected trials of each unit at most. [default: no limit]", show_default=False
    ),
]
Keep = Annotated[
    Path | None,
    typer.Option("--keep", metavar="DIR", help="Folder for copies of what is needed to play these findings again."),
]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    for command in (change, batch, prune, accept, init):
        group.command()(command)
    app.add_typer(group, name="ci", help="Test a repository: each change, each night, and which findings are fixed.")


@declared(RunOptions)
def change(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: Units = None,
    baseline: Baseline = DEFAULT_BASELINE,
    minutes: Annotated[
        float, typer.Option("--minutes", "-m", min=0.01, help="Time for all units together, in minutes.")
    ] = 5.0,
    trials: Trials = None,
    stop_early: Annotated[
        bool, typer.Option("--stop-early/--no-stop-early", help="End the test of a unit at its first new finding.")
    ] = True,
    strict: Strict = False,
    **given: Any,
) -> None:
    """Test a change for a few minutes.

    Exit 1 only for a confirmed finding that the baseline does not know, or marks as fixed.
    """
    from riot_bus.ci.ci import CiPlan, run_ci
    from riot_bus.findings.known import KnownFindings

    known, run = KnownFindings.load(baseline), RunOptions(**given)
    units, opened = _opened(system, unit, run, known=known, lenient=not strict)
    plan = CiPlan(minutes, stop_early=stop_early, explain=False, trials=trials)
    _tell(run_ci(units, opened, out=run.out, known=known, plan=plan), known, run.form, strict=strict)


@declared(RunOptions)
def batch(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: Units = None,
    baseline: Baseline = DEFAULT_BASELINE,
    minutes: Annotated[
        float, typer.Option("--minutes", "-m", min=0.01, help="Time for all units together, in minutes.")
    ] = 60.0,
    trials: Trials = None,
    update: Annotated[bool, typer.Option("--update", help="Add new findings to the baseline.")] = False,
    keep: Keep = None,
    strict: Strict = False,
    **given: Any,
) -> None:
    """Test for long, and explain what is found.

    Exit 1 only for a finding that the baseline does not know, or marks as fixed.
    """
    from riot_bus.ci.ci import CiPlan, run_ci
    from riot_bus.ci.ci_baseline import accept as accepted
    from riot_bus.ci.ci_baseline import check_keep, moment
    from riot_bus.findings.known import KnownFindings

    known, run = KnownFindings.load(baseline), RunOptions(**given)
    check_keep(known, keep)
    units, opened = _opened(system, unit, run, known=known, lenient=not strict)
    plan = CiPlan(minutes, stop_early=False, explain=True, trials=trials)
    result = run_ci(units, opened, out=run.out, known=known, plan=plan)
    more = list[str]()
    if update:
        folders = [one.directory for each in result.units for one in each.view.current]
        newer, more = accepted(known, folders, since=moment(system.parent), keep=keep, reopen=False)
        more += [f"written: {newer.save()}"] if more else []
    _tell(result, known, run.form, strict=strict, more=more)


@declared(RunOptions, "out", "seed", "jobs", "executor", "form")
def prune(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: Units = None,
    baseline: Baseline = DEFAULT_BASELINE,
    update: Annotated[bool, typer.Option("--update", help="Mark what is fixed in the baseline.")] = False,
    strict: Strict = False,
    **given: Any,
) -> None:
    """Say which known findings are fixed. Exit 1 only if one that was marked as fixed fails again."""
    from riot_bus.ci.ci_baseline import moment
    from riot_bus.ci.ci_baseline import prune as pruned
    from riot_bus.cli.chain import show
    from riot_bus.findings.known import KnownFindings

    known, run = KnownFindings.load(baseline), RunOptions(**given)
    units, opened = _opened(system, unit, run, fresh=True)
    result = pruned(units, opened, out=run.out, known=known, when=moment(system.parent))
    more = [f"written: {result.known.save()}"] if update and result.known.entries != known.entries else []
    show({"findings": result.to_json()}, run.form, [*_missing(known), *result.lines(), *more])
    if code := result.exit_code(strict=strict):
        raise typer.Exit(code)


def accept(
    findings: Annotated[
        list[Path], typer.Argument(metavar="FINDING...", help="Folders of findings, or output folders.")
    ],
    *,
    baseline: Baseline = DEFAULT_BASELINE,
    note: Annotated[str | None, typer.Option(help="Note on these findings, such as the number of a ticket.")] = None,
    keep: Keep = None,
) -> None:
    """Add findings to the baseline, so that they fail no build; those that were marked as fixed are open again."""
    from riot_bus.ci.ci_baseline import accept as accepted
    from riot_bus.ci.ci_baseline import found_in, moment
    from riot_bus.findings.known import KnownFindings

    known = KnownFindings.load(baseline)
    folders = found_in(findings)
    newer, lines = accepted(known, folders, since=moment(baseline.absolute().parent), note=note, keep=keep)
    lines += [f"written: {newer.save()}; next, commit it"] if lines else ["nothing has changed"]
    print_lines(lines)


def init(
    *,
    github: Annotated[bool, typer.Option("--github", help="A workflow of GitHub Actions.")] = False,
    gitlab: Annotated[bool, typer.Option("--gitlab", help="Jobs for GitLab, to be included.")] = False,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Root of the repository.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write the workflow for GitHub or GitLab: changes, nightly batches, and what is fixed."""
    from riot_bus.ci.ci_init import init_ci

    print_lines(init_ci(folder, github=github, gitlab=gitlab, force=force))


def _opened(
    system: Path,
    names: Sequence[str] | None,
    options: RunOptions,
    *,
    known: KnownFindings | None = None,
    lenient: bool = False,
    fresh: bool = False,
) -> tuple[list[str], Callable[[str, Path], AbstractContextManager[Workspace]]]:
    """Return the units, and a function that opens the workspace of one."""
    from riot_bus.ci.ci import unit_folder, units_of
    from riot_bus.cli.chain import open_workspace
    from riot_bus.report.follow import reports_of

    units = units_of(system, names or ())
    asked = reports_of(options.reports, {unit: unit_folder(options.out, unit) for unit in units})
    working = partial(open_workspace, system, fresh=fresh, known=known, lenient=lenient)
    return units, lambda unit, folder: working(replace(options, out=folder, reports=asked[unit]))


def _tell(
    result: CiResult, known: KnownFindings, form: StreamFormat, *, strict: bool, more: Sequence[str] = ()
) -> None:
    from riot_bus.cli.chain import show
    from riot_bus.vocabulary.redaction import escape_control_chars

    for line in result.warnings():
        warn(f"riot: {escape_control_chars(line, keep=chr(10))}")
    code = result.exit_code(strict=strict)
    units = [unit.to_json() for unit in result.units]
    show({"units": units, "new": len(result.failures)}, form, [*_missing(known), *result.lines(), *more])
    if code:
        raise typer.Exit(code)


def _missing(known: KnownFindings) -> list[str]:
    return [f"there is no {known.path}, so nothing is known: every finding is new"] if known.missing else []
