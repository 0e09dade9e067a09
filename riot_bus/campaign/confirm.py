"""Confirmation: a failure seen once may be due to chance or machine load; fresh trials show how often it occurs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from riot_bus.statistics.noise import Noise
from riot_bus.statistics.rates import Proportion, proportion
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase

GAP_NS = 1_000_000
"""Nanoseconds between the end of a log and the start of the next, when logs are joined."""

CONFIRMATIONS = 20
"""Largest number of fresh trials of a case."""

_FIRST = 4
"""Trials of the first batch: four failures of four bound the rate from below by 0.4 at 95 %, which is enough."""
_DOUBT, _SPREAD = 0.005, 0.15
"""Accepted doubt whether the case triggers the failure or it is chance, and accepted spread of the rate; then trials
end. A failure in one of five trials is missed once in eighty-seven times."""


def join_logs(logs: Sequence[Sequence[Message]]) -> tuple[Message, ...]:
    """Return logs as one, each a millisecond after the end of the one before."""
    joined: list[Message] = []
    for log in logs:
        if not log:
            continue
        shift = joined[-1].time + GAP_NS - log[0].time if joined else 0
        joined += [message.with_(time=message.time + shift) for message in log]
    return tuple(joined)


def more_nominal(case: TestCase, played: int, runner: Runner) -> Sequence[Outcome]:
    """Return trials of twice as many nominal messages, as growth may come with any message, and injections add some."""
    log = join_logs([case.messages] * (2 * math.ceil(played / len(case.messages))))
    return runner.run([replace(case, messages=log, injections=(), again=number) for number in range(_FIRST)])


def repeat(case: TestCase, signature: str, runner: Runner) -> Proportion:
    """Return the share of judged fresh trials that fail with a signature; the case was chosen for an earlier one."""
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
    """Return a case and its failure rate, as it was, or with order kept across topics if it fails more often then.

    A unit may take a log that is fed as fast as possible in another order, so a failure that depends on the order may
    come and go.
    """
    rate = repeat(case, signature, runner)
    topics = {message.key for message in case.messages}
    if rate.hits == rate.total or len(topics) < 2 or case.ordered:
        return case, rate
    kept = replace(case, ordered=True)
    better = repeat(kept, signature, runner)
    return (kept, better) if better.rate > rate.high or (better.rate == 1.0 and rate.rate < 1.0) else (case, rate)
