"""`riot test`, `demo`, a command for each step of the chain, `analyze`, `reproduce`, and `step` for plug-ins."""

from __future__ import annotations

import inspect
import json
from contextlib import contextmanager
from dataclasses import replace
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from riot_bus.cli.declared import declared
from riot_bus.cli.options import (
    DEFAULT_OUT,
    DEFAULT_SYSTEM,
    Finding,
    FindingsSystem,
    RunOptions,
    StreamFormat,
    System,
    UnitName,
)
from riot_bus.findings.steps import STEPS, ChainStep, find_step, further_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.findings.known import KnownFindings

_ExitCode = IntEnum("_ExitCode", {"FAULTS": 1, "INCONCLUSIVE": 5})  # listed in docs/chain.md
_TRIALS = 100  # a guess: about a minute at the demo's 0.5 s per trial on two cores

Trials = Annotated[
    int | None,
    typer.Option(
        "--trials",
        "-n",
        min=1,
        help="Maximum number of injected trials of the unit. [default: 100, no limit if another option ends the test]",
        show_default=False,
    ),
]
Seconds = Annotated[
    float | None, typer.Option("--seconds", "-t", min=0.1, help="Time for trials of the unit, in seconds.")
]
Covered = Annotated[bool, typer.Option("--covered", help="End once each value and fault has been tried.")]

_OF_FINDING = ("jobs", "executor", "form")
"""Options of commands that go on with a finding; its folder and its record say the others."""


class _StepGroup(TyperGroup):
    """The steps of other packages; one is imported when it is named."""

    def list_commands(self, ctx: Any) -> list[str]:
        return further_steps()

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in further_steps():
            return None
        app = typer.Typer()
        app.command(cmd_name)(_command(find_step(cmd_name)))
        return typer.main.get_command(app)


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command("test")(run_tests)
    app.command()(demo)
    for step in STEPS[1:]:
        app.command(step.name)(_command(step))
    for command in (analyze, reproduce):
        app.command()(command)
    others = typer.Typer(cls=_StepGroup, no_args_is_help=True)
    others.callback()(lambda: None)
    app.add_typer(others, name="step", help="Run a step of another package on a finding.")


@contextmanager
def open_workspace(
    system: Path,
    options: RunOptions,
    *,
    fresh: bool = False,
    known: KnownFindings | None = None,
    lenient: bool = False,
) -> Iterator[Workspace]:
    """Open a workspace whose events are shown on stderr and in reports, and which ends on signals.

    Arguments are those of `Workspace` and `ReportFollower`; the form in `options` says what stdout is for.
    """
    from rich.console import Console

    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.cli.narrate import ConsoleNarrator, write_line
    from riot_bus.control.signals import END_S, ended_by_signals
    from riot_bus.processes.launcher import TORN_DOWN_WITHIN_S
    from riot_bus.report.follow import ReportFollower, asked_report

    console = Console(stderr=True)
    out, form = options.out, options.form
    asked = [asked_report(each, out=out) for each in options.reports]
    say = partial(typer.echo, nl=False, err=form is not StreamFormat.TEXT)
    with (
        ended_by_signals(_interrupt, deadline=END_S + TORN_DOWN_WITHIN_S),
        ReportFollower(asked, out, say, known=known, lenient=lenient) as follower,
        ConsoleNarrator(console) as narrator,
    ):
        try:
            with Workspace(
                system,
                out,
                jobs=options.jobs,
                seed=options.seed,
                listeners=[narrator, follower, *([write_line] if form is StreamFormat.NDJSON else [])],
                fresh=fresh,
                executor=options.executor,
            ) as workspace:
                yield workspace
        except KeyboardInterrupt:
            narrator.interrupted(out)
            raise


def _interrupt() -> None:
    raise KeyboardInterrupt


@contextmanager
def _of_finding(
    finding: Path, options: RunOptions, system: Path | None = None, *, fresh: bool = False
) -> Iterator[tuple[Workspace, Path]]:
    from riot_bus.chain.base.systems import system_of
    from riot_bus.chain.base.workspace import open_finding

    folder, record = open_finding(finding)
    options = replace(options, out=folder.parent.parent, seed=record.seed)
    with open_workspace(system_of(record.system_file, folder, named=system), options, fresh=fresh) as workspace:
        yield workspace, folder


def show(result: dict[str, Any], form: StreamFormat, lines: list[str]) -> None:
    """Write a result to stdout."""
    if form is StreamFormat.TEXT:
        typer.echo("\n".join(lines))
    elif form is StreamFormat.JSON:
        typer.echo(json.dumps(result, indent=1))
    else:
        typer.echo(json.dumps({"event": "Result", **result}))


def _command(step: ChainStep) -> Callable[..., None]:
    """Return the command of a step: `riot NAME [FINDING]` with the step's options."""

    def command(finding: Path, *, system: Path | None, **given: Any) -> None:
        run = RunOptions(**{name: given.pop(name) for name in _OF_FINDING if name in given})
        with _of_finding(finding, run, system) as (workspace, folder):
            options = {name: () if value is None else value for name, value in given.items()}
            record = workspace.carry_out(step, folder, **options)
        show(record.model_dump(mode="json"), run.form, [str(folder / record.FILE)])

    named = inspect.Parameter.KEYWORD_ONLY
    parameters = [
        inspect.Parameter("finding", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=DEFAULT_OUT, annotation=Finding),
        *(
            inspect.Parameter(
                one.name,
                named,
                default=None if one.default == () else one.default,
                annotation=Annotated[
                    list[str] | None if one.default == () else type(one.default),
                    typer.Option(help=one.help, min=one.min),
                ],
            )
            for one in step.options
        ),
        inspect.Parameter("system", named, default=None, annotation=FindingsSystem),
    ]
    command.__doc__ = step.help
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return declared(RunOptions, *_OF_FINDING)(command)


@declared(RunOptions, "out", "seed", *_OF_FINDING)
def demo(
    *,
    budget: Annotated[int, typer.Option("--budget", min=1, help="Maximum number of injected trials.")] = 60,
    system: Annotated[
        Path | None, typer.Option("--system", "-s", help="System file to use instead of the rover's.")
    ] = None,
    **given: Any,
) -> None:
    """Run all steps on the example rover, from a nominal recording to the inputs that make the system fail."""
    from riot_bus.chain.base.systems import find_example
    from riot_bus.chain.steps.demo import demo as run_demo
    from riot_bus.findings.records import CampaignRecord
    from riot_bus.report.text import summary

    run = RunOptions(**given)
    with open_workspace(system or find_example("rover"), run) as workspace:
        figures = run_demo(workspace, trials=budget)
    finding = figures.get("finding")
    doubts = [] if figures["findings"] else CampaignRecord.load(run.out).doubts
    lines = [f"inconclusive: {doubt}" for doubt in doubts] or ["no finding"]
    show(figures, run.form, [summary(Path(finding)), f"report: {figures['report']}"] if finding else lines)
    if doubts:
        raise typer.Exit(_ExitCode.INCONCLUSIVE)


@declared(RunOptions)
def run_tests(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: UnitName = None,
    trials: Trials = None,
    seconds: Seconds = None,
    covered: Covered = False,
    whole_system: Annotated[
        bool, typer.Option("--whole-system", help="Run the whole system and inject into what comes from outside.")
    ] = False,
    **given: Any,
) -> None:
    """Test one unit, or the whole system, with exceptional values, and group failures into findings."""
    from riot_bus.chain.steps.analyze import to_explain
    from riot_bus.chain.steps.robustness import test_unit
    from riot_bus.findings.records import CampaignRecord
    from riot_bus.report.text import unchecked

    run = RunOptions(**given)
    with open_workspace(system, run) as workspace:
        name = workspace.context.file.choose_unit(unit)
        if trials is None and seconds is None and not covered:
            trials = _TRIALS
        found = test_unit(workspace, name, trials=trials, seconds=seconds, covered=covered, whole_system=whole_system)
    folders = [str(folder) for folder in found]
    record = CampaignRecord.load(run.out)
    doubts = [f"inconclusive: {doubt}" for doubt in record.doubts]
    lines = [*map(str, to_explain(found)), *unchecked(found)] or doubts or ["no finding"]
    unjudged = [each.model_dump(mode="json") for each in record.unjudged]
    show({"unit": name, "findings": folders, "notes": record.notes, "unjudged": unjudged}, run.form, lines)
    if folders or record.doubts:
        raise typer.Exit(_ExitCode.FAULTS if folders else _ExitCode.INCONCLUSIVE)


@declared(RunOptions)
def analyze(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: UnitName = None,
    trials: Trials = None,
    seconds: Seconds = None,
    within: Annotated[
        str | None,
        typer.Option(
            "--for", metavar="TIME", help="Time for all steps together, such as 30min; --trials then has no effect."
        ),
    ] = None,
    further: Annotated[
        list[str] | None, typer.Option("--step", help="Also run this step of another package; repeatable.")
    ] = None,
    prune: Annotated[
        bool, typer.Option("--prune/--no-prune", help="Leave out external topics with no path to the relevant fields.")
    ] = True,
    **given: Any,
) -> None:
    """Run all steps on a system, from test to report; run it again to go on where it stopped."""
    from riot_bus.chain.steps.analyze import analyze_all
    from riot_bus.chain.steps.robustness import test_unit, tested
    from riot_bus.chain.steps.within import analyze_within
    from riot_bus.config.arguments import parse_seconds
    from riot_bus.findings.records import CampaignRecord
    from riot_bus.report.finding_view import load
    from riot_bus.report.text import summary, unchecked
    from riot_bus.vocabulary.errors import ConfigError

    most_s = parse_seconds(within, "--for") if within is not None else None
    if most_s is not None and most_s <= 0:
        raise ConfigError("there is no time", where="--for", hint="write it like 90, 90s, 15min or 1h")
    if most_s is not None and seconds is not None:
        raise ConfigError("--for and --seconds exclude each other", hint="--for is the time for all steps together")
    options = {"permeability": {"prune": prune}}
    others = [find_step(name) for name in further or ()]
    run = RunOptions(**given)
    with open_workspace(system, run) as workspace:
        name = workspace.context.file.choose_unit(unit)
        if workspace.context.file.external.topics:
            workspace.context.file.check_outside_apart()  # else the chain would fail with this after its longest steps
        if most_s is not None:
            done = analyze_within(workspace, name, most_s, further=others, options=options)
            folders = list(dict.fromkeys([*(one.folder for one in done), *(tested(workspace, name) or [])]))
        else:
            most = _TRIALS if trials is None and seconds is None else trials
            known = tested(workspace, name)
            folders = (
                test_unit(workspace, name, trials=most, seconds=seconds, covered=False) if known is None else known
            )
            done = analyze_all(workspace, folders, further=others, options=options)
    rules = [load(one.folder).rule for one in done]
    result = [
        {"finding": str(one.folder), "rule": rule.text if rule else None, "report": str(one.report)}
        for one, rule in zip(done, rules, strict=True)
    ]
    doubts = [] if folders else CampaignRecord.load(run.out).doubts
    lines = [*(summary(one.folder) for one in done), *unchecked(folders), *(f"inconclusive: {each}" for each in doubts)]
    show({"findings": result}, run.form, lines or ["no finding"])
    if folders or doubts:
        raise typer.Exit(_ExitCode.FAULTS if folders else _ExitCode.INCONCLUSIVE)


@declared(RunOptions, *_OF_FINDING)
def reproduce(
    finding: Finding = DEFAULT_OUT,
    *,
    times: Annotated[
        int | None,
        typer.Option(
            "--times",
            min=1,
            help="Number of fresh trials. [default: as many as it takes to decide]",
            show_default=False,
        ),
    ] = None,
    whole_system: Annotated[
        bool,
        typer.Option(
            "--whole-system",
            help="Play the external messages of riot activate to the whole system, not the finding's log to its unit.",
        ),
    ] = False,
    system: FindingsSystem = None,
    **given: Any,
) -> None:
    """Check whether a finding still fails. Exit 0: fixed, 1: still failing, 4: cannot be run, 5: not decided."""
    from dataclasses import asdict

    from riot_bus.chain.steps.reproduce import reproduce as run_again
    from riot_bus.vocabulary.counting import counted

    run = RunOptions(**given)
    with _of_finding(finding, run, system, fresh=True) as (workspace, folder):
        result = run_again(workspace, folder, times=times, whole_system=whole_system)
    line = f"{result.answer}: {result.failed} of {counted(result.trials, 'trial')} of {result.log} fail"
    sure = f"the probability of this would be {result.missed:.1%} if the failure came as often as before"
    told = f" ({result.detail or sure})" if result.detail or not result.failed else ""
    show(asdict(result), run.form, [line + told])
    if result.failed:
        raise typer.Exit(_ExitCode.FAULTS)
