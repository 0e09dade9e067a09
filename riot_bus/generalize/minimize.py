"""Minimisation: the few messages of a failing log that are needed for the failure (RIOT II-B a).

A weighted search finds the shortest failing prefix, which ends with a needed message. Keep that one, cut what follows
it, and repeat with the kept ones in front until they alone fail. This takes about log2(n) trials per needed message;
delta debugging takes two to three times as many. Answers may be wrong: each search continues until its result is likely
enough, and a message that was cut wrongly is found to be missing and searched for again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from riot_bus.generalize.oracle import FAILS, SURE, BudgetSpentError, Trials
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.trial import Ask, Progress

BUDGET = 2000
"""Trials at most: enough for three needed of 5,000 failing three times in ten (about 400), or 150 that always do."""

CONFIDENCE = 0.95
"""Confidence in all claims about the result together."""

_DOUBT = 0.03
"""What ends the trials of the result and of each message's need together, less than what may be claimed: rates of 0.9
are often not told from 1 by then (benchmarks/noise.py)."""

_UNNEEDED = 0.1
"""Prior that a message which a search has found is not needed after all, or that those found are not enough."""


@dataclass(frozen=True, slots=True)
class Minimal:
    """The result of a minimisation.

    Attributes:
        kept: Indices into the log, ascending.
        one_minimal: Whether it was shown that `kept` triggers the failure, and does not without any one message.
        confidence: Lower bound of the confidence in that; 0 if it was not shown.
        failed: Failing trials of `kept`, and trials in total.
        without: The same for each message of `kept`, when it alone is left out.
    """

    kept: tuple[int, ...]
    trials: int
    one_minimal: bool
    confidence: float
    failed: tuple[int, int]
    without: tuple[tuple[int, int], ...]
    noise: Noise

    @property
    def doubt(self) -> float:
        """How likely it is that `kept` does not trigger the failure, or that not all of it is needed.

        Parts that were never asked do not count.
        """
        noise = self.noise
        counts = [(failed, total - failed) for failed, total in (self.failed, *self.without)]
        doubts = [1 - noise.triggers(*counts[0], prior=1 - _UNNEEDED)]
        return sum(doubts + [noise.triggers(*of, prior=_UNNEEDED) for of in counts[1:] if sum(of)])


def minimize(
    n: int,
    ask: Ask[tuple[int, ...]],
    *,
    weights: Sequence[float] | None = None,
    groups: Sequence[str] | None = None,
    causes: Collection[int] | None = None,
    likely: bool = False,
    noise: Noise | None = None,
    budget: int = BUDGET,
    parallelism: int = 1,
    progress: Progress | None = None,
    better: Callable[[Minimal], None] | None = None,
) -> Minimal:
    """Find a 1-minimal failing part of a log.

    A question is an ascending tuple of kept messages, of 0..n-1 in log order, and each time a fresh trial; True =
    failed with the same signature. Without any of the `causes` a part has another cause, and is not asked. If the whole
    log is `likely` minimal, that is checked first. `better` gets each smaller part that was found to fail. Once the
    budget is spent, the best so far is the result, marked as not proven.

    Raises:
        InconclusiveError: If the whole log does not fail.
        ValueError: If `weights` or `groups` do not have `n` entries, or a weight is negative.
    """
    if n < 0 or any(given is not None and len(given) != n for given in (weights, groups)):
        raise ValueError(f"weights and groups need one entry for each of the {n} messages")
    prior = [1.0] * n if weights is None else [float(weight) for weight in weights]
    if wrong := [f"{weight} (message {number})" for number, weight in enumerate(prior) if not weight >= 0]:
        raise ValueError(f"weights must not be negative or NaN: {', '.join(wrong[:3])}")
    trials: Trials[tuple[int, ...]] = Trials(
        ask, key=lambda question: question, noise=noise, budget=budget, parallelism=parallelism, progress=progress
    )
    return _Search(trials, prior, groups, None if causes is None else frozenset(causes), better, tuple(range(n))).run(
        likely=likely
    )


@dataclass
class _Search:
    """The state of one run of `minimize`; `best` is the smallest part found to fail, at first the whole log."""

    trials: Trials[tuple[int, ...]]
    prior: list[float]
    groups: Sequence[str] | None
    causes: frozenset[int] | None
    better: Callable[[Minimal], None] | None
    best: tuple[int, ...]

    def run(self, *, likely: bool) -> Minimal:
        whole = self.best
        try:
            if not whole:
                self._check_whole()
            idle = not likely and self._may((), ()) and self._fails((), 0.02, "checking the empty log")
            if not whole or idle:
                return self._result((), shown=True)
            return self._result(self._minimal(whole if likely else ()), shown=True)
        except BudgetSpentError:
            return self._result(self.best, shown=False)

    def _check_whole(self) -> None:
        """Ask whether the whole log fails; fresh trials have shown it before, so only where nothing has failed yet."""
        what = f"the whole log ({len(self.prior)} messages)"
        self.trials.require(
            tuple(range(len(self.prior))),
            prior=FAILS,
            doubt=_DOUBT,
            doing="checking the whole log",
            what=what,
            so="there is nothing to minimise",
        )

    def _fails(self, kept: tuple[int, ...], prior: float, doing: str) -> bool:
        return self.trials.triggers([kept], prior=prior, doubt=_DOUBT / 2, doing=doing)[0] > 0.5

    def _minimal(self, kept: tuple[int, ...]) -> tuple[int, ...]:
        """Search, and check the result; a refuted result is repaired and checked again."""
        if kept:
            self._check_whole()
        kept = kept or self._search(())
        while True:
            while self._fails(kept, 1 - _UNNEEDED, "checking what was found"):
                self._found(kept)
                rest = self._without_removable(kept)
                if rest == kept:
                    if not self._sure(kept):
                        break
                    rest = self._without_removable(kept, prior=0.5, doubt=0.01)
                    if rest == kept:
                        return kept
                kept = rest
            if len(kept) == len(self.prior):  # there is nothing to add to what does not fail
                self._check_whole()
            kept = self._search(kept)

    def _sure(self, kept: tuple[int, ...]) -> bool:
        """Return whether the set that was found fails, judged by its trials alone.

        This takes at least two trials: the likeliest mistake is that a failure without its cause ended the search.
        """
        doing = "making sure of what was found"
        return self.trials.triggers([kept], prior=0.5, doubt=0.005, doing=doing, least=2)[0] > 0.5

    def _without_removable(
        self, kept: tuple[int, ...], *, prior: float = _UNNEEDED, doubt: float = _DOUBT
    ) -> tuple[int, ...]:
        """Return a part of a failing set without one message that is not needed, or the set if all are needed.

        The search chose the set by answers that may be chance, so in the last check prior knowledge does not count.
        """
        questions = [part for part in self._parts(kept) if self._may(part, ())]
        doing = "checking that every kept message is needed"
        doubt /= 2 * max(1, len(kept))
        chances = self.trials.triggers(questions, prior=prior, doubt=doubt, doing=doing, first=True)
        likeliest = max(range(len(questions)), key=chances.__getitem__, default=None)
        return kept if likeliest is None or chances[likeliest] < 0.5 else questions[likeliest]

    @staticmethod
    def _parts(kept: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Return the parts that lack one message each."""
        return [kept[:index] + kept[index + 1 :] for index in range(len(kept))]

    def _search(self, start: tuple[int, ...]) -> tuple[int, ...]:
        """Return a set that probably fails: the start and what searches for the shortest failing prefix find."""
        kept = list(start)
        prior, order = list(self.prior), self._order(kept, self.prior)
        cut = 0.0
        while order:
            masses = [prior[item] for item in order]
            total = sum(masses) or float(len(masses))
            least = 1e-3 * total / len(masses)  # those without weight are found too, later
            # "Nothing else is needed" gets half of the mass: most failures need one or two messages.
            start_prior = 0.5 if kept else 0.02
            alone = self.trials.noise.triggers(*self.trials.counts(tuple(sorted(kept))), prior=start_prior)

            def at(length: int, kept: list[int] = kept, order: list[int] = order) -> tuple[int, ...]:
                return tuple(sorted(kept + order[:length]))

            masses = [total * alone / max(1 - alone, 1e-9), *(max(mass, least) for mass in masses), total * cut]
            impossible = next(place for place in range(len(masses)) if self._may(kept, order[:place]))
            length = self.trials.flip(
                [0.0] * impossible + masses[impossible:],
                at,
                rises=True,
                sure=SURE,
                doing=f"looking for needed message {len(kept) + 1}",
            )
            if not self.trials.failed:
                self._check_whole()
            if length == 0:
                break
            if length > len(order):  # a needed message was cut
                order, cut = self._order(kept, prior), 0.0
                continue
            found = order[length - 1]
            kept.append(found)
            order, cut = order[: length - 1], 0.02  # prior that a needed message was cut
            self._found(tuple(sorted(kept + order)))
            if self.groups is not None and sum(self.groups[item] == self.groups[found] for item in kept) == 1:
                for item in order:
                    if self.groups[item] == self.groups[found]:
                        prior[item] *= 8  # likelier to be needed, as another one of its topic is
                order.sort(key=lambda item: (-prior[item], item))
        return tuple(sorted(kept))

    def _may(self, kept: Sequence[int], more: Sequence[int]) -> bool:
        """Return whether these messages may have the cause that is looked for."""
        return self.causes is None or not self.causes.isdisjoint(kept) or not self.causes.isdisjoint(more)

    def _order(self, kept: Sequence[int], prior: Sequence[float]) -> list[int]:
        chosen = set(kept)
        return sorted((item for item in range(len(prior)) if item not in chosen), key=lambda item: (-prior[item], item))

    def _found(self, part: tuple[int, ...]) -> None:
        if len(part) < len(self.best):
            self.best = part
            if self.better is not None:
                self.better(self._result(part, shown=False))

    def _result(self, kept: tuple[int, ...], *, shown: bool) -> Minimal:
        parts = self._parts(kept)
        of = [(failed, failed + passed) for failed, passed in map(self.trials.counts, (kept, *parts))]
        found = Minimal(kept, self.trials.spent, False, 0.0, of[0], tuple(of[1:]), self.trials.noise)  # noqa: FBT003
        unasked = any(self._may(part, ()) and not total for part, (_, total) in zip(parts, of[1:], strict=True))
        if not shown or unasked or found.doubt > 1 - CONFIDENCE:
            return found
        return replace(found, one_minimal=True, confidence=CONFIDENCE)
