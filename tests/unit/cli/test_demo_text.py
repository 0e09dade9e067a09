"""What `riot demo` prints is what docs/chain.md shows, from the records of the run in `docs/rover-finding/`."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from riot_bus.cli.narrate import ConsoleNarrator
from riot_bus.events import StepFinished
from riot_bus.findings.steps import STEPS, ChainStep
from riot_bus.report.text import summary

DOCS = Path(__file__).parents[3] / "docs"
FINDING = DOCS / "rover-finding"
SECTION = (DOCS / "chain.md").read_text(encoding="utf-8").partition("## What the demo prints")[2]
BLOCKS = re.findall(r"(?:^    .*\n)+", SECTION, re.MULTILINE)


def one_line(text: str) -> str:
    """Return a text without its line breaks and indentation, which the page has to keep its lines short."""
    return " ".join(text.split())


@pytest.mark.parametrize("step", STEPS[1:], ids=lambda step: step.name)
def test_a_step_says_what_it_has_found(step: ChainStep) -> None:
    record, stream = step.kind.load(FINDING), io.StringIO()
    with ConsoleNarrator(Console(file=stream)) as narrator:
        narrator(StepFinished(step.name, record.summary, record.seconds, record.trials, str(FINDING), None))
    assert one_line(stream.getvalue()) in one_line(BLOCKS[0])


def test_the_finding_is_summed_up_at_the_end() -> None:
    told = summary(FINDING).replace(str(FINDING), "riot-out/findings/crash-planner-f0c094")
    assert one_line(told) in one_line(BLOCKS[1])
