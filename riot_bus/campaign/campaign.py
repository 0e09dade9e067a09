"""A campaign of robustness tests on one unit: seeded, resumable, bounded by trials or time (RIOT II-A)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.campaign.triage import Failure, group
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.campaign.schedule import Schedule
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Progress, Runner

__all__ = ["CampaignResult", "run_campaign"]


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """What a campaign found.

    Attributes:
        failures: By signature, in the order of discovery.
        failing: Number of failing trials.
        exhausted: Whether the budget of trials was used up (False: time ran out, or the campaign was told to stop).
    """

    trials: int
    failing: int
    failures: Mapping[str, Failure]
    exhausted: bool


def run_campaign(
    messages: Sequence[Message],
    schedule: Schedule,
    runner: Runner,
    *,
    seed: int,
    trials: int,
    seconds: float | None = None,
    progress: Progress | None = None,
) -> CampaignResult:
    """Run trials until the budget ends.

    Args:
        messages: The nominal log of the unit's inputs.
        schedule: Draws the injections of each trial.
        runner: Executes test cases.
        seed: Seed of the campaign.
        trials: At most so many injected trials.
        seconds: At most so much time; None for no limit.
        progress: Told after each batch.

    Raises:
        InconclusiveError: The unit fails on the nominal log already, in one of two trials.
    """
    log = tuple(messages)
    check = runner.run([TestCase(log, seed=seed), TestCase(log, seed=seed + 1)])
    failures: dict[str, Failure] = {}
    bad = [outcome for outcome in check if outcome.verdict is Verdict.FAIL]
    if bad and len(bad) < len(check):
        raise InconclusiveError(
            f"the unit fails on the nominal log in one of two trials: {bad[0].violations[0].signature}",
            hint="make it deterministic, give it more time to settle ([unit.NAME.settle]), or use another nominal log",
        )
    if bad:
        group(failures, bad[0], trial=-1, injections=(), modified=0)
        return CampaignResult(len(check), len(bad), failures, exhausted=False)
    started = time.monotonic()
    done = failing = 0
    while done < trials and (seconds is None or time.monotonic() - started < seconds):
        batch = range(done, min(trials, done + 2 * runner.parallelism))
        cases = [TestCase(log, schedule.injections(trial), seed=seed) for trial in batch]
        for trial, case, outcome in zip(batch, cases, runner.run(cases), strict=True):
            failing += _judge(failures, trial, case, outcome)
        done = batch.stop
        if progress:
            progress(done, trials, f"{failing} failing, {len(failures)} distinct")
    return CampaignResult(done + len(check), failing, failures, exhausted=done >= trials)


def _judge(failures: dict[str, Failure], trial: int, case: TestCase, outcome: Outcome) -> int:
    if outcome.verdict is not Verdict.FAIL:
        return 0
    modified = int(outcome.statistics.get("modified", len(case.injections)))
    group(failures, outcome, trial=trial, injections=case.injections, modified=modified)
    return 1
