"""The questions of a rule search: asked in batches within a budget, with guesses of their answers, and asked again.

Where an answer takes several trials, an expected one takes fewer, so each question goes with the probability that it
fails, by the present rule and by how often rules have been right before.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.oracle import FAILS, WAVES, assignment_key
from riot_bus.generalize.refine import decisive
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import Assignment, Variable, columns_of
from riot_bus.generalize.table import Table
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask

_GUESSED = ("explore",)
"""Phases whose answers the rule may predict: not those where rules disagree or at limits, nor those that judge it."""
_MOST_REVISIONS = 40
"""Maximum number of revisions; more trials would not resolve what is still in doubt."""
_DOUBT = 0.06
"""A rule is always expected to be wrong in at least one of sixteen new questions, so each takes a few trials."""

AskExpecting = Callable[[Sequence[Mapping[str, Setting]], Sequence[float]], Sequence[bool]]
"""Like `Ask`, with the probability that each question is answered by True; it may be asked the same again."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One trial of the rule search.

    `phase` is "start", "explore", "committee", "threshold", "validate", "decide" (between rules that explain all trials
    before) or "context" (variables outside of the rule have other values, too).
    """

    assignment: Mapping[str, Setting]
    failed: bool
    phase: str


class Questions:
    """The questions of a search, their answers, and the budget.

    Args:
        told: Called after every batch with the number of trials so far and the phase.

    Attributes:
        rule: The present rule, by which answers are guessed.
        samples: All answers; `table` has those that rules are learnt from.
        spent: Questions that counted for the budget.
    """

    def __init__(
        self,
        variables: Sequence[Variable],
        ask: Ask[Mapping[str, Setting]],
        expecting: AskExpecting | None,
        told: Callable[[int, str], None],
        *,
        budget: int,
        parallelism: int,
    ) -> None:
        self.variables = tuple(variables)
        self.table = Table(variables)
        self.samples: list[Sample] = []
        self.rule = Rule(())
        self.budget = budget
        self.parallelism = parallelism
        self.spent = 0
        self._plain = ask
        self._expecting = expecting
        self._told = told
        self._asked: set[Hashable] = set()
        self._guesses = self._wrong_guesses = self._revisions = 0

    @property
    def trials(self) -> int:
        """Number of all questions."""
        return len(self._asked)

    def ask(self, questions: Sequence[Assignment], phase: str) -> list[Sample]:
        """Ask what was not asked yet (within the budget, validation aside) and learn the outcomes."""
        return self.ask_at_once({phase: questions})

    def ask_at_once(self, questions: Mapping[str, Sequence[Assignment]]) -> list[Sample]:
        """Ask questions of several phases, which then share batches; see `ask`."""
        fresh: dict[Hashable, tuple[Assignment, str]] = {}
        for phase, ones in questions.items():
            for one in ones:
                if not self.known(one):
                    fresh.setdefault(assignment_key(one), (one, phase))
        new = list(fresh.values())
        if not questions.keys() & {"validate", "context", "decide"}:
            new = new[: max(0, self.budget - self.spent)]
            self.spent += len(new)
        asked: list[Sample] = []
        guessed = not questions.keys().isdisjoint(_GUESSED)
        at_once = (1 if guessed else WAVES) * self.parallelism  # what was wrong changes further guesses
        for first in range(0, len(new), at_once):
            batch = new[first : first + at_once]
            guesses = self._guessed(batch)
            assignments = [one for one, _ in batch]
            answers = self._expecting(assignments, guesses) if self._expecting else self._plain(assignments)
            if len(answers) != len(batch):
                raise InconclusiveError(f"{len(batch)} trials were asked for, but {len(answers)} outcomes came back")
            for (one, phase), guess, answer in zip(batch, guesses, answers, strict=True):
                asked.append(Sample(one, bool(answer), phase))
                if self.rule.terms and phase in _GUESSED:
                    self._guesses += 1
                    self._wrong_guesses += (guess > 0.5) != asked[-1].failed
            self._asked.update(map(assignment_key, assignments))
            self._told(len(self._asked), batch[-1][1])
        self.samples += asked
        if "context" in questions:
            return asked
        self.table.add([sample.assignment for sample in asked], [sample.failed for sample in asked])
        return asked

    def revise(self, learnt: Learnt) -> bool:
        """Ask again what a rule gets wrong, if answers may be wrong; return whether any answer has changed."""
        if not learnt.terms:
            return False
        said = learnt.rule.predict(columns_of(self.variables, [one.assignment for one in self.samples])).tolist()
        wrong = [n for n, one in enumerate(self.samples) if one.failed != said[n]]
        return self._change(wrong[:8])  # if there are more, the rule is wrong

    def settle(self) -> bool:
        """Ask again what the rule depends on, if answers may be wrong; return whether any answer has changed."""
        rows = [n for n, one in enumerate(self.samples) if one.phase != "context"]
        columns = columns_of(self.variables, [self.samples[n].assignment for n in rows])
        failed = np.array([self.samples[n].failed for n in rows], dtype=bool)
        return bool(self.rule.terms) and self._change([rows[n] for n in decisive(self.rule, columns, failed)])

    def _change(self, numbers: Sequence[int]) -> bool:
        """Ask for samples as if the opposite of their answers were likely; return whether any answer has changed."""
        if self._expecting is None or self._revisions >= _MOST_REVISIONS:
            return False
        self._revisions += 1
        guesses = [_DOUBT if self.samples[n].failed else 1 - _DOUBT for n in numbers]
        answers = self._expecting([self.samples[n].assignment for n in numbers], guesses) if numbers else ()
        changed = [n for n, answer in zip(numbers, answers, strict=True) if bool(answer) != self.samples[n].failed]
        rows = [n for n, one in enumerate(self.samples) if one.phase != "context"]
        for n in changed:
            self.samples[n] = replace(self.samples[n], failed=not self.samples[n].failed)
            if self.samples[n].phase != "context":
                self.table.failed[rows.index(n)] = self.samples[n].failed
        return bool(changed)

    def said(self, assignments: Iterable[Assignment]) -> Array:
        """Return for each assignment whether the present rule predicts the failure."""
        return self.rule.predict(columns_of(self.variables, list(assignments)))

    def _guessed(self, questions: Sequence[tuple[Assignment, str]]) -> list[float]:
        """Return how likely questions are to fail, by the rule and by how often it has been right before."""
        if not self._asked:
            return [FAILS]
        if not self.rule.terms:
            return [0.5] * len(questions)
        doubt = min(0.5, max(_DOUBT, (self._wrong_guesses + 1) / (self._guesses + 2)))
        chances = [1 - doubt if fails else doubt for fails in self.said(one for one, _ in questions)]
        return [chance if phase in _GUESSED else 0.5 for chance, (_, phase) in zip(chances, questions, strict=True)]

    def known(self, question: Assignment) -> bool:
        """Return whether a question was asked."""
        return assignment_key(question) in self._asked

    def mistakes(self, checked: Sequence[Sample]) -> int:
        """Return how many samples the present rule gets wrong."""
        said = self.said(sample.assignment for sample in checked)
        return sum(bool(one) != sample.failed for one, sample in zip(said, checked, strict=True))
