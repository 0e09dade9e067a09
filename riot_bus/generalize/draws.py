"""New questions for a rule search: nominal cases, cases with one known value, and draws near what is known."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

from riot_bus.generalize.oracle import assignment_key
from riot_bus.generalize.questions import Questions
from riot_bus.generalize.refine import inversions
from riot_bus.generalize.sampling import Assignment, Sampler, changed, row_of
from riot_bus.generalize.table import Candidate
from riot_bus.vocabulary.elements import Setting

_POOL, _SURFACES = 240, 60
"""New cases of which those are chosen that decide most, and features at whose thresholds more are sought: a guess."""


class Draws:
    """Draws questions that were not asked yet."""

    def __init__(self, questions: Questions, chance: random.Random) -> None:
        self.variables = questions.variables
        self.sampler = Sampler(questions.variables)
        self.random = chance
        self._table, self._known = questions.table, questions.known
        self._decks: dict[object, list[dict[str, Setting]]] = {}

    def alone(self, base: Assignment) -> Assignment:
        """Return the base with one variable at its next known value, the most exceptional values first."""
        key = assignment_key(base)
        if key not in self._decks:
            cards = []
            for variable in self.variables:
                values = sorted(self.sampler.known[variable.name], key=lambda _: self.random.random())
                values.sort(key=lambda value: value == value)  # NaN, which no comparison notices, comes first
                cards += [(rank, {**base, variable.name: value}) for rank, value in enumerate(values)]
            self._decks[key] = [card for _, card in sorted(cards, key=lambda card: -card[0])]
        deck = self._decks[key]
        while deck:
            card = deck.pop()
            if not self._known(card):
                return card
        return self.explore()

    def nominal(self) -> dict[str, Setting]:
        """Draw a nominal value of each variable."""
        return {
            variable.name: self.random.choice(variable.nominal or variable.passing or (variable.failing,))
            for variable in self.variables
        }

    def pool(self) -> list[Assignment]:
        """Return new assignments: draws from the mixture, and known samples with one or two variables redrawn."""
        pool: list[Assignment] = [self.sampler.assignment(self.random) for _ in range(_POOL // 2)]
        bad = [one for one, failed in zip(self._table.assignments, self._table.failed, strict=True) if failed]
        for _ in range(_POOL // 2):
            source = bad if self.random.random() < 0.5 else self._table.assignments
            redrawn = dict(self.random.choice(source))
            for variable in self.random.sample(self.variables, 1 if len(self.variables) < 3 else 2):
                redrawn[variable.name] = self.sampler.value(variable, self.random)
            pool.append(redrawn)
        return [assignment for assignment in pool if not self._known(assignment)]

    def surfaces(self, candidates: Sequence[Candidate]) -> list[Assignment]:
        """Return new assignments at the thresholds of features of several variables, seldom met by chance."""
        several = [one for one in candidates if len(one.feature.args) > 1 and isinstance(one.inside, int | float)]
        found: list[Assignment] = []
        for candidate in self.random.sample(several, min(_SURFACES, len(several))):
            base = self.random.choice(self._table.assignments) if self.random.random() < 0.5 else self.nominal()
            assert isinstance(candidate.inside, int | float)
            if not math.isfinite(candidate.inside):
                continue
            row = row_of(self.variables, base)
            change = self.random.choice(inversions(candidate.feature, row, candidate.inside) or [{}])
            moved = changed(self.variables, base, dict(change))
            if moved is not None:
                found.append(moved)
        return [assignment for assignment in found if not self._known(assignment)]

    def explore(self) -> Assignment:
        """Return one new assignment; a known one if draws give no new one."""
        pool = self.pool()
        return pool[0] if pool else self.sampler.assignment(self.random)
