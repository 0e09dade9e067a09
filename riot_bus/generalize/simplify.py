"""Simplification: values as simple as they can be while the failure stays (RIOT II-B a).

Each thing that can be simplified is a ladder of values, from the simplest to the current one. First, those that cannot
take their simplest value are found, like the needed messages of a log; then the lowest failing rung of each of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from riot_bus.generalize.minimize import BUDGET, minimize
from riot_bus.generalize.oracle import SURE, BudgetSpentError, Trials
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress

Levels = tuple[int, ...]
"""A rung for each ladder."""


@dataclass(frozen=True, slots=True)
class Simplified:
    """The result: a rung for each ladder, all trials asked, and what is known of the rates of failure by now."""

    levels: Levels
    trials: int
    noise: Noise


def simplify(
    sizes: Sequence[int],
    ask: Ask[Levels],
    *,
    noise: Noise | None = None,
    budget: int = BUDGET,
    parallelism: int = 1,
    progress: Progress | None = None,
    better: Callable[[Levels], None] | None = None,
) -> Simplified:
    """Find the simplest values with which the failure still occurs.

    Each thing to simplify has a list of values, its ladder. A rung is the position of a value in that list: 0 is the
    simplest one, and the last rung is the present value.

    Sizes are the numbers of rungs, at least two each; the last rungs together are known to fail. A question has a rung
    for each ladder, and is each time a fresh trial; True = failed with the same signature. `better` gets lower rungs as
    they are found to fail. Once the budget is spent, the lowest failing rungs so far are the result.

    Returns:
        The lowest failing rungs that were found; the last ones if the failure does not occur any more.
    """
    now = tuple(size - 1 for size in sizes)
    told = better or (lambda _: None)
    spent, known = 0, noise or Noise.after()
    if len(sizes) > 1:
        last = now
        try:  # ladders that cannot take their lowest rung are like needed messages
            needed = minimize(
                len(sizes),
                lambda questions: ask([_at(last, kept) for kept in questions]),
                noise=noise,
                budget=budget,
                parallelism=parallelism,
                progress=progress,
                better=lambda part: told(_at(last, part.kept)),
            )
        except InconclusiveError:  # it does not fail any more
            return Simplified(now, 0, known)
        now, spent, known = _at(now, needed.kept), needed.trials, needed.noise
    trials: Trials[Levels] = Trials(
        ask, key=lambda levels: levels, noise=known, budget=budget - spent, parallelism=parallelism, progress=progress
    )
    try:
        if len(sizes) == 1 and _fails((0,), 0.1, trials):
            now = (0,)
            told(now)
        for place, size in enumerate(sizes):
            if now[place] and size > 2:
                now = _with_lower(now, place, size, trials)
                told(now)
    except BudgetSpentError:  # what was found so far fails all the same
        pass
    return Simplified(now, spent + trials.spent, trials.noise)


def _at(last: Levels, kept: Sequence[int]) -> Levels:
    """Return the lowest rungs, but for ladders that stay at their last one."""
    return tuple(level if place in kept else 0 for place, level in enumerate(last))


def _fails(levels: Levels, prior: float, trials: Trials[Levels]) -> bool:
    return trials.triggers([levels], prior=prior, doubt=0.02, doing="trying simpler values")[0] > 0.5


def _with_lower(now: Levels, place: int, size: int, trials: Trials[Levels]) -> Levels:
    """Return `now` with a lower failing rung on one ladder that cannot take its lowest; `now` if there is none."""

    def at(rung: int) -> Levels:
        return (*now[:place], rung + 1, *now[place + 1 :])

    found = trials.flip([1.0] * (size - 1), at, rises=True, sure=SURE, doing="trying simpler values")
    return at(found) if found < size - 2 and _fails(at(found), 0.9, trials) else now
