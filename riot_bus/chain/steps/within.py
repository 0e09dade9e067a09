"""The whole chain within a given time: testing leaves time for explanations, and uses what they leave over.

The unit is tested for a share of the time. The findings so far are then explained, each in an equal share of the time
left, of which each step gets its usual part by a smaller budget, and the unit is tested further in the time that
remains, and so on. Without a finding, the unit is tested to the end. So the work ends when the time is over and the
running trials have ended, or earlier if further trials would show nothing new, such as of a unit that always fails.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.analyze import Analysis, Options, analyze, to_explain, with_other_causes
from riot_bus.chain.steps.robustness import test_unit
from riot_bus.events import TimeLeft
from riot_bus.findings.records import CampaignRecord
from riot_bus.findings.steps import ChainStep


def analyze_within(
    workspace: Workspace,
    unit: str,
    seconds: float,
    *,
    further: Sequence[ChainStep] = (),
    options: Options | None = None,
    now: Callable[[], float] = time.monotonic,
) -> list[Analysis]:
    """Test a unit and explain what is found, until the time is over.

    Unfinished steps continue if time is left in the end, and with the next command: no trial is lost.

    Raises:
        RiotError: As `test_unit` and `analyze`.
    """
    begin = now()
    end = begin + seconds
    done: dict[Path, Analysis] = {}

    def tell() -> float:
        left = _left(end, now)
        workspace.tell(TimeLeft(left, seconds))
        return left

    def explain(folders: Sequence[Path]) -> None:
        for folder, count in with_other_causes(folders):
            workspace.until = until = now() + tell() / count
            left = partial(_left, until, now)
            try:
                done[folder] = analyze(workspace, folder, further=further, options=options, left=left)
            finally:
                workspace.until = None

    def unexplained(folders: Sequence[Path]) -> list[Path]:
        return [folder for folder in to_explain(folders) if folder not in done or done[folder].unfinished]

    while (left := tell()) > 0.05 * seconds:  # with less, a campaign would only repeat what is stored
        until = now() + left * 0.3  # explaining a finding takes about twice the trials that find it

        def enough(found: Sequence[Path], until: float = until) -> str:
            if now() >= end:
                return "the time is over"
            return "the time that is left is for what was found" if now() >= until and unexplained(found) else ""

        folders = test_unit(workspace, unit, trials=None, seconds=None, covered=False, stop=enough)
        explain(unexplained(folders))
        if not CampaignRecord.load(workspace.out).stopped:  # no further trial would say more
            break
    return list(done.values())


def _left(end: float, now: Callable[[], float]) -> float:
    return max(0.0, end - now())
