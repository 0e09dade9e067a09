"""Layer between a search and a batch oracle: fresh trials, and decisions from all of them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Generic, TypeVar

from riot_bus.statistics.noise import FlipSearch, Noise
from riot_bus.vocabulary.elements import Elements, Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress

QuestionT = TypeVar("QuestionT")

WAVES = 4
"""Trials for each slot in one batch whose questions do not depend on each other's answers: slots wait for each other
only at its end, and progress is still told often."""

FAILS = 0.98
"""Prior that what a search begins with fails: it was confirmed, or minimised."""

SURE = 0.95
"""Confidence that ends one search; later checks find mistakes. More costs trials, less errs on flaky units."""


def scalar_key(value: Setting) -> Hashable:
    """Return a key equal exactly for bit-identical values (NaN equals itself, -0.0 is not 0.0, True is not 1)."""
    if isinstance(value, Elements):
        return ("elements", value.key)
    if isinstance(value, float):
        return ("float", struct.pack("<d", value))
    return (type(value).__name__, value)


def same_scalar(left: Setting, right: Setting) -> bool:
    """Return whether two values are bit-identical."""
    return scalar_key(left) == scalar_key(right)


def assignment_key(assignment: Mapping[str, Setting]) -> Hashable:
    """Return a key of one value per field, independent of the order of the fields."""
    return tuple((name, scalar_key(assignment[name])) for name in sorted(assignment))


class BudgetSpentError(Exception):
    """The budget of trials is spent; the search catches this and returns what it has found."""


class Trials(Generic[QuestionT]):
    """Trials of a search: asks each time by a fresh trial, decides from all answers, and learns their reliability.

    All methods that ask raise BudgetSpentError if there are no trials left for it.

    Args:
        key: Function whose result is equal for questions that are the same.
    """

    def __init__(
        self,
        ask: Ask[QuestionT],
        *,
        key: Callable[[QuestionT], Hashable],
        noise: Noise | None,
        budget: int,
        parallelism: int = 1,
        progress: Progress | None = None,
    ) -> None:
        self._ask = ask
        self._key = key
        self._budget = budget
        self.parallelism = max(1, parallelism)
        self._progress = progress
        self._counts: dict[Hashable, tuple[int, int]] = {}
        self.noise = noise or Noise.after()
        self.spent = self.failed = 0

    def counts(self, question: QuestionT) -> tuple[int, int]:
        """Return how many trials of a question have failed, and how many passed."""
        return self._counts.get(self._key(question), (0, 0))

    def flip(
        self,
        masses: Sequence[float],
        at: Callable[[int], QuestionT],
        *,
        rises: bool,
        sure: float,
        doing: str,
        told: Sequence[tuple[int, bool]] = (),
    ) -> int:
        """Return the hypothesis that a `FlipSearch` over prior weights finds.

        `at` gives the input at a position; inputs trigger the failure from the flip on if it `rises`, else before it.
        `told` are positions that `ask` has already answered, with whether they failed.
        """
        search = FlipSearch(masses, self.noise, rises=rises)
        for position, failed in told:
            search.tell(position, failed=failed)
        while search.confidence < sure:
            positions = search.questions(self._batch())
            for position, failed in zip(positions, self._asked([at(place) for place in positions], doing), strict=True):
                search.tell(position, failed=failed)
        self.noise = search.noise
        return search.found

    def triggers(
        self,
        questions: Sequence[QuestionT],
        *,
        prior: float | Sequence[float],
        doubt: float,
        doing: str,
        least: int = 1,
        first: bool = False,
    ) -> list[float]:
        """Return for each question the probability that it triggers the failure.

        Questions differ from each other; each needs at least `least` trials, earlier ones included. A probability below
        `doubt`, or above 1 - doubt, decides. With `first`, it stops at the first question that is found to trigger it.
        """
        searches = []
        priors = [prior] * len(questions) if isinstance(prior, float) else prior
        for question, before in zip(questions, priors, strict=True):
            chance = self.noise.triggers(*self.counts(question), prior=before)
            searches.append(FlipSearch([chance, 1 - chance], self.noise, rises=True))

        def probability(index: int) -> float:
            search = searches[index]
            return search.confidence if search.found == 0 else 1 - search.confidence

        while True:
            chances = [probability(index) for index in range(len(questions))]
            asked = [sum(self.counts(question)) >= least for question in questions]
            if first and any(enough and chance > 1 - doubt for enough, chance in zip(asked, chances, strict=True)):
                break
            open_ = [i for i, chance in enumerate(chances) if not asked[i] or doubt < chance < 1 - doubt]
            if not open_:
                break
            batch = open_[: self._batch(1 if first else WAVES)]
            for i, failed in zip(batch, self._asked([questions[i] for i in batch], doing), strict=True):
                searches[i].tell(0, failed=failed)
        self.noise = self.noise.joined([search.noise for search in searches])
        return chances

    def require(self, question: QuestionT, *, prior: float, doubt: float, doing: str, what: str, so: str) -> None:
        """Raise an error, which says `what` does not trigger the failure, `so` what follows, unless a question does.

        Raises:
            InconclusiveError: It probably does not trigger the failure.
        """
        if self.triggers([question], prior=prior, doubt=doubt, doing=doing)[0] < 0.5:
            failed, passed = self.counts(question)
            raise InconclusiveError(
                f"{what} does not fail with this signature ({failed} of {failed + passed} trials), so {so}",
                hint="replay it several times; it may fail too rarely to be told apart from chance",
            )

    def decide(
        self, questions: Sequence[QuestionT], *, doubt: float, doing: str, priors: Sequence[float] | None = None
    ) -> list[bool]:
        """Return for each question whether it triggers the failure; equal ones are decided together."""
        known = self.noise  # it is not known how many of them do, so their trials say nothing about the rates
        by_key = {self._key(question): question for question in questions}
        likely = dict(zip(map(self._key, questions), priors or [0.5] * len(questions), strict=True))
        prior = [likely[key] for key in by_key]
        chances = self.triggers(list(by_key.values()), prior=prior, doubt=doubt, doing=doing)
        self.noise = known
        found = {key: chance > 0.5 for key, chance in zip(by_key, chances, strict=True)}
        return [found[self._key(question)] for question in questions]

    def _batch(self, waves: int = 1) -> int:
        """Return how many questions to ask at once; several waves of them where no answer makes another needless."""
        left = self._budget - self.spent
        if left <= 0:
            raise BudgetSpentError
        return min(waves * self.parallelism, left)

    def ask(self, questions: Sequence[QuestionT], doing: str) -> list[bool]:
        """Return whether one fresh trial of each question failed, for the first ones that fit in one batch."""
        return self._asked(questions[: self._batch()], doing)

    def _asked(self, questions: Sequence[QuestionT], doing: str) -> list[bool]:
        answers = [bool(answer) for answer in self._ask(questions)]
        if len(answers) != len(questions):
            raise InconclusiveError(f"{len(questions)} trials were asked for, but {len(answers)} outcomes came back")
        self.spent += len(questions)
        self.failed += sum(answers)
        for question, failed in zip(questions, answers, strict=True):
            key = self._key(question)
            fails, passes = self._counts.get(key, (0, 0))
            self._counts[key] = (fails + failed, passes + (not failed))
        if self._progress is not None:
            self._progress(self.spent, None, doing)
        return answers
