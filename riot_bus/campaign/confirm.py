"""Confirmation: a failure seen once may be chance, or a loaded machine; fresh trials tell how often it comes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.statistics.noise import Noise
from riot_bus.statistics.rates import Proportion, proportion

if TYPE_CHECKING:
    from riot_bus.vocabulary.trial import Runner, TestCase

__all__ = ["CONFIRMATIONS", "repeat", "repeat_in_order"]

CONFIRMATIONS = 20
"""Fresh trials of a case at most."""

_FIRST = 4
"""Four fresh failures of four bound the rate from below by 0.4 at 95 %, which is enough to go on with."""
_DOUBT, _SPREAD = 0.005, 0.15
"""Trials end when it is decided whether the case triggers the failure, or it is chance, and the rate is known so well.
A failure of one in five is missed once in eighty-seven times."""


def repeat(case: TestCase, signature: str, runner: Runner) -> Proportion:
    """Return how often fresh trials of a case fail with a signature, of those that could be judged.

    Args:
        case: The case; the trial that failed first does not count, since it was chosen for that.
        signature: The failure.
        runner: Executes trials.
    """
    hits = total = asked = 0
    while asked < CONFIRMATIONS:
        count = _FIRST if not asked else min(CONFIRMATIONS - asked, max(_FIRST, runner.parallelism))
        cases = [replace(case, again=number) for number in range(asked + 1, asked + count + 1)]
        judged = [outcome for outcome in runner.run(cases) if outcome.judged]
        hits += sum(outcome.failed_as(signature) for outcome in judged)
        asked, total = asked + count, total + len(judged)
        if total < _FIRST:
            continue
        triggers = Noise.after().triggers(hits, total - hits)
        if triggers < _DOUBT or (triggers > 1 - _DOUBT and Noise.after(hits, total).spread <= _SPREAD):
            break
    return proportion(hits, total)


def repeat_in_order(case: TestCase, signature: str, runner: Runner) -> tuple[TestCase, Proportion]:
    """Return how often a case fails, played as it was, or with the order across topics kept if it fails more often so.

    A log that is fed as fast as possible may be taken in another order than it has, and a failure that depends on that
    order then comes and goes.

    Args:
        case: The case.
        signature: The failure.
        runner: Executes trials.
    """
    rate = repeat(case, signature, runner)
    topics = {message.key for message in case.messages}
    if rate.hits == rate.total or len(topics) < 2 or case.ordered:
        return case, rate
    kept = replace(case, ordered=True)
    better = repeat(kept, signature, runner)
    return (kept, better) if better.rate > rate.high or (better.rate == 1.0 and rate.rate < 1.0) else (case, rate)
