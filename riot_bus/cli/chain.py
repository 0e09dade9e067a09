"""`riot demo`, `test`, `minimize`, `relevance`, `rules`, `permeability`, `activate`, `analyze`, `reproduce`."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.options import Finding, Format, Jobs, Out, OutputFormat, Seed, System, UnitName

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from riot_bus.chain.workspace import Workspace
    from riot_bus.findings.records import Artefact

__all__ = ["register"]

DEFAULT_SYSTEM = Path("riot.toml")
DEFAULT_OUT = Path("riot-out")
FAULTS = 1

Trials = Annotated[int, typer.Option("--trials", "-n", min=1, help="Budget: injected trials of the unit.")]
Seconds = Annotated[float | None, typer.Option("--seconds", "-t", min=0.1, help="Budget: time for the unit's trials.")]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command("test")(run_tests)
    for command in (demo, minimize, relevance, rules, permeability, activate, analyze, reproduce):
        app.command()(command)


@contextmanager
def _workspace(system: Path, out: Path, jobs: int, seed: int) -> Iterator[Workspace]:
    from rich.console import Console

    from riot_bus.chain.workspace import Workspace
    from riot_bus.cli.narrate import ConsoleNarrator

    with (
        ConsoleNarrator(Console(stderr=True)) as narrator,
        Workspace(system, out, jobs=jobs, seed=seed, narrator=narrator) as workspace,
    ):
        yield workspace


@contextmanager
def _of_finding(finding: Path, jobs: int, system: Path | None = None) -> Iterator[tuple[Workspace, Path]]:
    from riot_bus.chain.workspace import open_finding

    folder, record = open_finding(finding)
    out = folder.parent.parent
    with _workspace(system or Path(record.system_file), out, jobs, record.seed) as workspace:
        yield workspace, folder


def _show(result: dict[str, Any], form: OutputFormat, lines: list[str]) -> None:
    typer.echo(json.dumps(result, indent=1) if form is OutputFormat.JSON else "\n".join(lines))


def demo(
    *,
    out: Out = DEFAULT_OUT,
    seed: Seed = 0,
    jobs: Jobs = 0,
    budget: Annotated[int, typer.Option("--budget", min=1, help="Budget: injected trials of the unit.")] = 60,
    form: Format = OutputFormat.TEXT,
    system: Annotated[Path | None, typer.Option("--system", "-s", help="Another system than the rover.")] = None,
) -> None:
    """Run the whole chain on the rover, from a nominal recording to the inputs that make the system fail."""
    from riot_bus.chain.demo import demo as run_demo
    from riot_bus.chain.demo import find_example
    from riot_bus.report.text import summary

    with _workspace(system or find_example("rover"), out, jobs, seed) as workspace:
        figures = run_demo(workspace, trials=budget)
    finding = figures.get("finding")
    lines = [summary(Path(finding)), f"report: {figures['report']}"] if finding else ["no finding"]
    _show(figures, form, lines)


def run_tests(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: UnitName = None,
    out: Out = DEFAULT_OUT,
    trials: Trials = 100,
    seconds: Seconds = None,
    seed: Seed = 0,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Test one unit with exceptional values and group its failures into findings."""
    from riot_bus.chain.robustness import test_unit

    with _workspace(system, out, jobs, seed) as workspace:
        name, _ = workspace.unit(unit)
        folders = [str(folder) for folder in test_unit(workspace, name, trials=trials, seconds=seconds)]
    _show({"unit": name, "findings": folders}, form, folders or ["no finding"])
    if folders:
        raise typer.Exit(FAULTS)


def _run_step(finding: Path, jobs: int, form: OutputFormat, step: Callable[[Workspace, Path], Artefact]) -> None:
    with _of_finding(finding, jobs) as (workspace, folder):
        record = step(workspace, folder)
    _show(record.model_dump(mode="json"), form, [str(folder / record.FILE)])


def minimize(finding: Finding = DEFAULT_OUT, *, jobs: Jobs = 0, form: Format = OutputFormat.TEXT) -> None:
    """Shrink a finding's failing log to the few messages that are needed."""
    from riot_bus.chain.minimize import minimize as step

    _run_step(finding, jobs, form, step)


def relevance(finding: Finding = DEFAULT_OUT, *, jobs: Jobs = 0, form: Format = OutputFormat.TEXT) -> None:
    """Find the fields that matter, each with two trials that differ in it alone."""
    from riot_bus.chain.relevance import relevance as step

    _run_step(finding, jobs, form, step)


def rules(
    finding: Finding = DEFAULT_OUT,
    *,
    budget: Annotated[int, typer.Option("--budget", min=10, help="Trials for learning.")] = 160,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Learn when exactly the unit fails, as a rule in one line."""
    from riot_bus.chain.rules import rules as step

    _run_step(finding, jobs, form, lambda workspace, folder: step(workspace, folder, budget=budget))


def permeability(
    finding: Finding = DEFAULT_OUT,
    *,
    runs: Annotated[int, typer.Option("--runs", min=2, help="Long runs of the whole system.")] = 8,
    prune: Annotated[bool, typer.Option(help="Leave out what cannot reach by the declared graph.")] = True,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Find the external fields that reach the relevant ones, by perturbing the whole system."""
    from riot_bus.chain.permeability import permeability as step

    _run_step(finding, jobs, form, lambda workspace, folder: step(workspace, folder, runs=runs, prune=prune))


def activate(
    finding: Finding = DEFAULT_OUT,
    *,
    budget: Annotated[int, typer.Option("--budget", min=1, help="Runs of the whole system for the search.")] = 200,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Drive the external inputs until the whole system fails."""
    from riot_bus.chain.activation import activation as step

    _run_step(finding, jobs, form, lambda workspace, folder: step(workspace, folder, budget=budget))


def analyze(
    *,
    system: System = DEFAULT_SYSTEM,
    unit: UnitName = None,
    out: Out = DEFAULT_OUT,
    trials: Trials = 100,
    seconds: Seconds = None,
    seed: Seed = 0,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Run the whole chain on a system; run it again to go on where it stopped."""
    from riot_bus.chain.analyze import analyze as run_chain
    from riot_bus.chain.robustness import test_unit, tested
    from riot_bus.report.text import summary

    with _workspace(system, out, jobs, seed) as workspace:
        name, _ = workspace.unit(unit)
        folders = tested(workspace, name)
        if folders is None:
            folders = test_unit(workspace, name, trials=trials, seconds=seconds)
        done = [run_chain(workspace, folder) for folder in folders]
    result = [
        {"finding": str(one.folder), "rule": one.rule.text if one.rule else None, "report": str(one.report)}
        for one in done
    ]
    _show({"findings": result}, form, [summary(one.folder) for one in done] or ["no finding"])
    if folders:
        raise typer.Exit(FAULTS)


def reproduce(
    finding: Finding = DEFAULT_OUT,
    *,
    times: Annotated[int, typer.Option("--times", min=1, help="Fresh trials.")] = 3,
    whole_system: Annotated[
        bool, typer.Option("--whole-system", help="Play the external messages to the whole system instead.")
    ] = False,
    system: Annotated[Path | None, typer.Option("--system", "-s", help="Another system file than recorded.")] = None,
    jobs: Jobs = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Does a finding still fail? Exit 0 fixed, 1 still failing, 4 cannot be run, 5 flaky."""
    from dataclasses import asdict

    from riot_bus.chain.reproduce import reproduce as run_again

    with _of_finding(finding, jobs, system) as (workspace, folder):
        result = run_again(workspace, folder, times=times, whole_system=whole_system)
    line = f"{result.answer}: {result.failed} of {result.trials} trials of {result.log} fail"
    _show(asdict(result), form, [line + (f" ({result.detail})" if result.detail else "")])
    if result.failed:
        raise typer.Exit(FAULTS)
