"""Failures only after other test cases in the same process: search for one log that makes a fresh process fail so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.campaign.confirm import join_logs, repeat
from riot_bus.campaign.triage import Failure
from riot_bus.chain.questions import FreshCases
from riot_bus.generalize.minimize import minimize
from riot_bus.inject.apply import inject_log
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.campaign.history import AfterOthers
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Progress, Runner

__all__ = ["shrink_history"]

_TRIES = 8
"""Most trials of the whole, long history until one fails; a failure in 3 of 10 trials is missed once in 17 times."""


def shrink_history(
    found: AfterOthers,
    runner: Runner,
    *,
    registry: TypeRegistry,
    probe: Sequence[Message],
    progress: Progress | None = None,
) -> Failure | None:
    """Return the failure with the fewest earlier cases that a fresh process needs for it; None if it does not recur.

    Its case has one log: these cases with their injections, each followed by the probe, and then the last case.

    Args:
        found: The failure and the cases before it.
        runner: Runner of trials, each in a process of its own.
        registry: Registry that names topics.
        probe: Messages that the unit got after each case.
        progress: Called during the search.
    """
    *before, last = (
        inject_log(case.messages, case.injections, registry=registry, seed=case.seed)[0]
        for case in (*found.before, found.case)
    )
    signature = found.violation.signature

    def case_of(kept: Sequence[int]) -> TestCase:
        messages = join_logs([*(part for number in kept for part in (before[number], probe)), last])
        return TestCase(messages, seed=found.case.seed, ordered=found.case.ordered)

    fresh = FreshCases(runner)

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        return [outcome.failed_as(signature) for outcome in fresh.run([case_of(kept) for kept in questions])]

    batch = [tuple(range(len(before)))] * min(runner.parallelism, _TRIES)
    if not any(any(ask(batch)) for _ in range(-(-_TRIES // len(batch)))):
        return None
    minimal = minimize(len(before), ask, parallelism=runner.parallelism, progress=progress)
    case = case_of(minimal.kept)
    outcome = Outcome(Verdict.FAIL, (found.violation,))
    failure = Failure(found.violation, case, 0, outcome, len(minimal.kept) + 1, occurrences=found.occurrences)
    failure.details.append(f"{found.violation.detail} (after {len(minimal.kept)} earlier test cases)")
    failure.rate = repeat(case, signature, runner)
    return failure if failure.confirmed else None
