"""Extrapolation: the rule over the relevant fields that says when the failure happens (RIOT II-B c).

Trials around the failing and the passing values, then active learning: learn a small DNF over derived features, ask
where a committee of such rules disagrees, put thresholds between ever closer trials, and validate on fresh trials.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np

from riot_bus.generalize.beam import Learnt, learn
from riot_bus.generalize.features import Array
from riot_bus.generalize.oracle import Oracle, assignment_key
from riot_bus.generalize.refine import probe_threshold, widen
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import Assignment, Sampler, Variable, columns_of, fitted
from riot_bus.generalize.table import Candidate, Table
from riot_bus.statistics.rates import Proportion, proportion
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress, Scalar

__all__ = ["LearnedRule", "Proportion", "Sample", "Variable", "learn_rule"]

COMMITTEE = 4
POOL = 240
VALIDATIONS = 3


@dataclass(frozen=True, slots=True)
class Sample:
    """One trial of the rule search; `phase` is "start", "explore", "committee", "threshold" or "validate"."""

    assignment: Mapping[str, Scalar]
    failed: bool
    phase: str


@dataclass(frozen=True, slots=True)
class LearnedRule:
    """A rule and how well it did on fresh trials that it was not learnt from.

    Half of the `checks` fresh trials (where they can be had) lie inside the rule and half outside; `precision` is the
    share of failures inside, `recall` the share of these trials' failures that lie inside.
    """

    rule: Rule
    precision: Proportion
    recall: Proportion
    balanced_accuracy: float
    checks: int
    samples: tuple[Sample, ...]
    trials: int


def learn_rule(
    variables: Sequence[Variable],
    ask: Ask[Mapping[str, Scalar]],
    *,
    seed: int,
    budget: int = 160,
    validation: int = 60,
    parallelism: int = 1,
    progress: Progress | None = None,
) -> LearnedRule:
    """Learn the simplest rule that explains when the failure happens.

    Args:
        variables: The relevant fields with what is known about their values.
        ask: Each question assigns a value to every variable; True = fails with the same signature.
        seed: Decides all draws.
        budget: Trials for learning; fewer are used once nothing is left to ask.
        validation: Fresh trials for one validation. Counterexamples are learnt from, and up to 3 validations are run
            (as long as the budget of learning trials lasts), on top of the budget.
        parallelism: Questions worth asking in one batch.
        progress: Told after every batch.

    Raises:
        InconclusiveError: If the failing values do not fail.
        ValueError: If there are no variables, two have one name, or a type is unknown or cannot hold a failing value.
        MissingExtraError: If scipy is not installed.
    """
    if not variables or len({variable.name for variable in variables}) != len(variables):
        raise ValueError("learn_rule needs at least one variable, with distinct names")
    variables = [fitted(variable) for variable in variables]
    oracle: Oracle[Mapping[str, Scalar]] = Oracle(ask, key=assignment_key, progress=progress)
    oracle.expected = budget + validation
    search = _Search(variables, oracle, seed=seed, budget=budget, parallelism=max(1, parallelism))
    with _one_thread():
        search.start()
        checked: list[Sample] = []
        for _ in range(VALIDATIONS):
            search.refine()
            checked = search.validate(validation)
            if not search.mistakes(checked) or search.spent >= budget:
                break
        return search.result(checked)


def _one_thread() -> AbstractContextManager[object]:
    """Keep numpy from spreading products of small matrices over all cores: it is several times slower."""
    try:
        from threadpoolctl import threadpool_limits  # type: ignore[import-untyped,unused-ignore]
    except ImportError:
        return nullcontext()
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


class _Search:
    """The state of one run of `learn_rule`."""

    def __init__(
        self,
        variables: Sequence[Variable],
        oracle: Oracle[Mapping[str, Scalar]],
        *,
        seed: int,
        budget: int,
        parallelism: int,
    ) -> None:
        self.variables = tuple(variables)
        self.oracle = oracle
        self.budget = budget
        self.parallelism = parallelism
        self.random = random.Random(seed)  # noqa: S311 - not for secrets
        self.sampler = Sampler(variables)
        self.table = Table(variables)
        self.samples: list[Sample] = []
        self.spent = 0
        self.rule = Rule(())
        self.turns: dict[object, int] = {}
        self.anchors: list[dict[str, Scalar]] = []
        self.decks: dict[object, list[dict[str, Scalar]]] = {}

    # -- asking ---------------------------------------------------------------------------------------------------

    def ask(self, questions: Sequence[Assignment], phase: str) -> list[Sample]:
        """Ask what was not asked yet (within the budget, validation aside) and learn the outcomes."""
        fresh = {assignment_key(q): q for q in questions if self.oracle.known(q) is None}
        new = list(fresh.values())
        if phase != "validate":
            new = new[: max(0, self.budget - self.spent)]
            self.spent += len(new)
        asked: list[Sample] = []
        for first in range(0, len(new), max(self.parallelism, 1)):
            batch = new[first : first + self.parallelism]
            answers = self.oracle.ask(batch, f"rules: {phase}")
            asked += [Sample(q, answer, phase) for q, answer in zip(batch, answers, strict=True)]
        self.samples += asked
        self.table.add([sample.assignment for sample in asked], [sample.failed for sample in asked])
        return asked

    def start(self) -> None:
        """Ask the failing and nominal values, each variable's known values alone, and a first spread of draws."""
        failing = {variable.name: variable.failing for variable in self.variables}
        if not self.ask([failing], "start")[0].failed:
            raise InconclusiveError(
                "the failing values do not fail with this signature, so there is no rule to learn",
                hint="replay them several times; if they fail only sometimes, raise the number of repetitions",
            )
        others = []
        for variable in self.variables:
            healing = [value for value in variable.passing if value != variable.failing]
            others += [{**failing, variable.name: value} for value in healing[:2]]
        nominal = [self._nominal() for _ in range(2)]
        self.anchors = [failing, *nominal]
        self.ask([*others, *nominal], "start")
        self.ask([self._alone(nominal[0]) for _ in range(max(self.budget // 8, 2 * len(self.variables)))], "start")
        self.ask([self._alone(failing) for _ in range(self.budget // 10)], "start")
        self.ask([self.sampler.assignment(self.random) for _ in range(self.budget // 8)], "explore")

    def _alone(self, base: Assignment) -> Assignment:
        """Return the base with one variable at its next known value, the most exceptional values first."""
        key = assignment_key(base)
        if key not in self.decks:
            cards = []
            for variable in self.variables:
                values = sorted(self.sampler.known[variable.name], key=lambda _: self.random.random())
                values.sort(key=lambda value: value == value)  # NaN, which no comparison notices, comes first
                cards += [(rank, {**base, variable.name: value}) for rank, value in enumerate(values)]
            self.decks[key] = [card for _, card in sorted(cards, key=lambda card: -card[0])]
        deck = self.decks[key]
        while deck:
            card = deck.pop()
            if self.oracle.known(card) is None:
                return card
        return self._explore()

    def _nominal(self) -> dict[str, Scalar]:
        return {
            variable.name: self.random.choice(variable.nominal or variable.passing or (variable.failing,))
            for variable in self.variables
        }

    # -- learning -------------------------------------------------------------------------------------------------

    def refine(self) -> None:
        """Learn and ask until the committee agrees and every threshold is exact, or the budget is spent."""
        calm = 0
        before: object = None
        while True:
            failed = np.array(self.table.failed, dtype=bool)
            candidates, masks = self.table.candidates()
            best = widen(self.table, learn(candidates, masks, failed))
            self.rule = best.rule
            if self.spent >= self.budget:
                return
            settled = best.shape == before
            before = best.shape
            count = max(self.parallelism, 1 if settled else 3)
            questions = self._committee(best, candidates, masks, failed, count)
            narrow = self._thresholds(best)
            calm = 0 if narrow or questions else calm + 1
            if calm > 2:
                return
            if not settled:
                narrow = self.random.sample(narrow, min(1, len(narrow)))
            self.ask(questions, "committee")
            self.ask(narrow, "threshold")
            if not settled or not questions or not narrow:
                self.ask([self._alone(self.random.choice(self.anchors)), self._explore()], "explore")

    def _committee(
        self, best: Learnt, candidates: list[Candidate], masks: Array, failed: Array, count: int
    ) -> list[Assignment]:
        """Return new assignments about which rules learnt from parts of the features disagree most."""
        pool = self._pool()
        columns = columns_of(self.variables, pool)
        votes = [best.rule.predict(columns)]
        weights = [2.0]
        features = sorted({candidate.feature for candidate in candidates})
        used = sorted({candidate.feature for term in best.terms for candidate in term})
        for member in range(COMMITTEE):
            dropped = set(self.random.sample(features, len(features) // 3))
            if used:
                dropped.add(used[member % len(used)])
            keep = [index for index, candidate in enumerate(candidates) if candidate.feature not in dropped]
            if not keep:
                continue
            rival = learn([candidates[index] for index in keep], masks[keep], failed, width=1, beam=16)
            votes.append(rival.rule.predict(columns))
            weights.append(1.0 if not rival.mistakes else 0.3 / rival.mistakes)
        share = np.average(np.array(votes, dtype=np.float64), axis=0, weights=weights)
        doubt = np.minimum(share, 1 - share)
        order = np.argsort(-doubt, kind="stable")
        return [pool[index] for index in order[:count].tolist() if doubt[index] > 0.01]

    def _thresholds(self, best: Learnt) -> list[Assignment]:
        """Return one narrowing trial per threshold of the best rule."""
        found = []
        for row, term in enumerate(best.terms):
            for column, candidate in enumerate(term):
                key = (candidate.feature, candidate.operator)
                turn = self.turns.get(key, 0)
                question = probe_threshold(self.table, best, (row, column), self.random, turn=turn)
                if question is not None and self.oracle.known(question) is None:
                    self.turns[key] = turn + 1
                    found.append(question)
        return found

    def _pool(self) -> list[Assignment]:
        """Return new assignments: draws from the mixture, and known samples with one or two variables redrawn."""
        pool: list[Assignment] = [self.sampler.assignment(self.random) for _ in range(POOL // 2)]
        bad = [sample.assignment for sample in self.samples if sample.failed]
        for _ in range(POOL // 2):
            source = bad if self.random.random() < 0.5 else self.table.assignments
            changed = dict(self.random.choice(source))
            for variable in self.random.sample(self.variables, 1 if len(self.variables) < 3 else 2):
                changed[variable.name] = self.sampler.value(variable, self.random)
            pool.append(changed)
        return [assignment for assignment in pool if self.oracle.known(assignment) is None]

    def _explore(self) -> Assignment:
        pool = self._pool()
        return pool[0] if pool else self.sampler.assignment(self.random)

    # -- validation -----------------------------------------------------------------------------------------------

    def validate(self, count: int) -> list[Sample]:
        """Ask fresh assignments, half inside the rule and half outside where they can be had."""
        pool: dict[object, Assignment] = {}
        for _ in range(4):
            drawn = [self.sampler.assignment(self.random) for _ in range(count * 2)]
            fresh = [assignment for assignment in (*drawn, *self._pool()) if self.oracle.known(assignment) is None]
            pool.update((assignment_key(assignment), assignment) for assignment in fresh)
        options = list(pool.values())
        if not options or count < 1:
            return []
        inside = self.rule.predict(columns_of(self.variables, options))
        hits = [option for option, hit in zip(options, inside, strict=True) if hit]
        rest = [option for option, hit in zip(options, inside, strict=True) if not hit]
        half = min(len(hits), max(count // 2, count - len(rest)))
        return self.ask([*hits[:half], *rest[: count - half]], "validate")

    def mistakes(self, checked: Sequence[Sample]) -> int:
        """Return how many samples the present rule gets wrong."""
        if not checked:
            return 0
        predicted = self.rule.predict(columns_of(self.variables, [sample.assignment for sample in checked]))
        return int((predicted != np.array([sample.failed for sample in checked])).sum())

    def result(self, checked: Sequence[Sample]) -> LearnedRule:
        """Return the rule with what the last validation said about it."""
        failed = np.array([sample.failed for sample in checked], dtype=bool)
        assignments = [sample.assignment for sample in checked]
        inside = self.rule.predict(columns_of(self.variables, assignments))
        caught = int((inside & failed).sum())
        precision = proportion(caught, int(inside.sum()))
        recall = proportion(caught, int(failed.sum()))
        correct = proportion(int((~inside & ~failed).sum()), int((~failed).sum()))
        accuracy = (recall.rate + correct.rate) / 2
        return LearnedRule(
            self.rule, precision, recall, accuracy, len(checked), tuple(self.samples), self.oracle.trials
        )
