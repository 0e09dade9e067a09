"""`riot guard`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from riot_bus.cli.options import DEFAULT_OUT, Finding, Format, OutputFormat
from riot_bus.cli.printing import print_json, print_lines


class _Action(StrEnum):
    DROP = "drop"
    CLAMP = "clamp"
    HOLD = "hold"
    REPORT = "report"


def guard(
    finding: Finding = DEFAULT_OUT,
    *,
    action: Annotated[
        _Action, typer.Option("--action", "-a", help="What is done with a message that meets the rule.")
    ] = _Action.DROP,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Print the lines for riot.toml that put a guard in front of a unit, and what it does to the finding's logs."""
    from dataclasses import asdict

    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.chain.steps.guard import plan_guard

    plan = plan_guard(open_finding(finding)[0], action=action.value)
    if form is OutputFormat.JSON:
        print_json(asdict(plan))
        return
    print_lines(f"# {line}" for line in plan.lines())
    typer.echo(plan.toml)
