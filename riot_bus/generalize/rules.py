"""Extrapolation: the rule over the relevant fields that says when the failure happens (RIOT II-B c).

Trials around the failing and the passing values, then active learning: learn a small DNF over derived features, ask
where a committee of such rules disagrees, put thresholds between ever closer trials, and validate on fresh trials.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.generalize.beam import ERROR_BITS, Learnt, learn, learn_guarded
from riot_bus.generalize.draws import Draws
from riot_bus.generalize.edges import Flip, edges_of, farther_base, linear_features, middle_of
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import casts_of
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.oracle import assignment_key, same_scalar
from riot_bus.generalize.questions import AskExpecting, Questions, Sample
from riot_bus.generalize.refine import around, narrowed, probe_threshold, widen
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import Assignment, Variable, changed, columns_of, fitted, integer_range, row_of
from riot_bus.generalize.table import Candidate, Table, concrete
from riot_bus.generalize.validation import Estimate, near_limits, scores
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.trial import Ask, Progress

DOUBTFUL_BITS = 22.0
"""A rule of two plain thresholds is shorter than this; longer ones may stand for a linear feature."""
_SMALL = 16
"""A limit of whole numbers up to this may be one of an enumeration, which goes on, or has gaps, beyond it."""


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another rule that explains all trials equally well, and a case on which the two disagree."""

    rule: Rule
    decided_by: Mapping[str, Scalar]


@dataclass(frozen=True, slots=True)
class LearnedRule:
    """A rule and how well it did on fresh trials that it was not learnt from.

    Attributes:
        precision: Share of the predicted failures that fail, on the distribution stated in `validation`.
        recall: Share of the failures that are predicted, on that distribution.
        balanced_accuracy: Mean of recall and of the share of passing cases that are predicted; None if no fresh trial
            failed, or none passed.
        checks: Number of fresh trials behind these rates.
        alternatives: At most two rules that the trials do not distinguish from this one.
        varied_mistakes: Number of fresh trials with other values of variables outside of the rule that it gets wrong.
        varied_checks: Number of such trials.
    """

    rule: Rule
    precision: Estimate
    recall: Estimate
    balanced_accuracy: float | None
    checks: int
    samples: tuple[Sample, ...]
    trials: int
    alternatives: tuple[Alternative, ...] = ()
    varied_mistakes: int = 0
    varied_checks: int = 0


def learn_rule(
    variables: Sequence[Variable],
    ask: Ask[Mapping[str, Setting]],
    *,
    expecting: AskExpecting | None = None,
    seed: int,
    budget: int = 160,
    validation: int = 60,
    parallelism: int = 1,
    context: Sequence[Variable] = (),
    progress: Progress | None = None,
) -> LearnedRule:
    """Learn the simplest rule that explains when the failure happens.

    Args:
        variables: The relevant fields with what is known about their values.
        ask: Each question assigns a value to every variable; True = fails with the same signature.
        expecting: Called instead of `ask`, also with the probability that each question fails, estimated from how
            often the rules so far have been right: where an answer takes several trials, an expected one takes fewer.
            What a rule gets wrong is asked again.
        seed: Seed of all random draws.
        budget: Trials for learning; fewer are used once nothing is left to ask.
        validation: Fresh trials per validation, on top of the budget; up to 3 validations are run. Each that finds
            counterexamples adds half of the budget, for learning from them. After one that finds none, but for the
            last, trials decide between rules that explain all others; one against the rule counts as a counterexample.
        parallelism: Questions worth asking in one batch.
        context: Variables that should not matter. Every third fresh trial also gives them other nominal values.
        progress: Called after every batch.

    Raises:
        InconclusiveError: If the failing values do not fail.
        ValueError: If there are no variables, two have one name, or a type is unknown or cannot hold a failing value.
        MissingExtraError: If scipy is not installed.
    """
    if not variables or len({variable.name for variable in variables}) != len(variables):
        raise ValueError("learn_rule needs at least one variable, with distinct names")
    variables = [fitted(variable) for variable in variables]
    context = [variable for variable in map(fitted, context) if variable.nominal]

    def told(done: int, phase: str) -> None:
        if progress is not None:
            progress(done, budget + validation, f"rules: {phase}")

    questions = Questions(variables, ask, expecting, told, budget=budget, parallelism=max(1, parallelism))
    search = _Search(questions, random.Random(seed))  # noqa: S311 - not for secrets
    with _one_thread():
        search.start()
        checked: list[Sample] = []
        for left in reversed(range(3)):
            search.refine()
            while questions.settle():
                search.refine()
            checked = search.validate(validation, context)
            if checked and questions.revise(search.best):
                checked = questions.samples[-len(checked) :]
            # more trials of these variables cannot show what the context does
            wrong = questions.mistakes([sample for sample in checked if sample.phase != "context"])
            # a rule that a decision changes needs another validation
            if not wrong and not (left and validation and search.decide()):
                break
            questions.budget += budget // 2
        return search.result(checked)


def _one_thread() -> AbstractContextManager[object]:
    """Keep numpy from spreading products of small matrices over all cores: it is several times slower."""
    try:
        from threadpoolctl import threadpool_limits  # type: ignore[import-untyped,unused-ignore]
    except ImportError:
        return nullcontext()
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


def learn_from(table: Table) -> tuple[Learnt, list[Candidate], Array]:
    """Return the simplest rule for the trials so far, the literals it was chosen from, and where these hold."""
    failed = table.outcomes
    candidates, masks = table.candidates()
    best = learn(candidates, masks, failed)
    widened = [widen(table, best)]
    if _doubtful(best):
        columns = table.columns
        literals = {candidate: None for term in best.terms for candidate in term}
        # A second limit may be no flip among all samples, but is among those for which one literal of the rule holds.
        for literal in list(literals)[:3]:
            more, held = table.conditional(concrete(literal).holds(columns))
            candidates, masks = [*candidates, *more], np.vstack([masks, held])
        more_of = learn(candidates, masks, failed)
        widened.append(widen(table, more_of))
        widened.append(widen(table, learn_guarded(candidates, masks, failed, more_of)))
    return min(widened, key=lambda one: one.bits), candidates, masks


def consistent(table: Table, learnt: Learnt) -> Learnt | None:
    """Return a rule, or the one that is given, that gets no trial wrong; None if none is found.

    Seldom cases cost less than the literals that they need; each counts three times more here, worth three or four.
    """
    failed = table.outcomes
    columns = table.columns
    again = np.flatnonzero(learnt.rule.predict(columns) != failed).repeat(3)
    if not len(again):
        return learnt
    candidates, masks = table.candidates()
    found = widen(table, learn(candidates, np.hstack([masks, masks[:, again]]), np.append(failed, failed[again])))
    return None if (found.rule.predict(columns) != failed).any() else replace(found, mistakes=0)


def _counted(literal: Literal) -> tuple[int, ...]:
    """Return the whole numbers with which one variable is compared, if they may be those of an enumeration."""
    told = literal.value if isinstance(literal.value, tuple) else (literal.value,)
    members = tuple(one for one in told if isinstance(one, int) and not isinstance(one, bool))
    small = isinstance(literal.value, tuple) or all(abs(one) <= _SMALL for one in members)
    return members if literal.feature.kind in ("raw", "abs") and len(members) == len(told) and small else ()


def _doubtful(best: Learnt) -> bool:
    """Return whether a rule is longer than rules of one or two plain literals, or wrong."""
    return best.mistakes > 0 or best.bits > DOUBTFUL_BITS


class _Search:
    """Learns the rule and chooses what to ask next; `best` is the present rule with the intervals of its thresholds."""

    def __init__(self, questions: Questions, chance: random.Random) -> None:
        self.questions, self.table, self.variables = questions, questions.table, questions.variables
        self.ask, self.known = questions.ask, questions.known
        self.draws, self.random = Draws(questions, chance), chance
        self.sampler = self.draws.sampler
        self.best = Learnt((), 0.0, 0)
        self.share = 0.0
        self._owed, self._turn = 0, False
        self._sought = self._cast = False
        self._turns: dict[object, int] = {}
        self._turned: set[object] = set()
        self._completed: set[object] = set()
        self._anchors: list[dict[str, Setting]] = []

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
        nominal = [self.draws.nominal() for _ in range(2)]
        self._anchors = [failing, *nominal]
        self.ask([*others, *nominal], "start")
        budget = self.questions.budget
        self.ask([self.draws.alone(nominal[0]) for _ in range(max(budget // 8, 2 * len(self.variables)))], "start")
        self.ask([self.draws.alone(failing) for _ in range(budget // 10)], "start")
        self.ask([self.sampler.assignment(self.random) for _ in range(budget // 8)], "explore")

    def refine(self) -> None:
        """Learn and ask until the committee agrees and every threshold is exact, or the budget is spent."""
        calm = 0
        before: object = None
        settled = False
        while True:
            failed = self.table.outcomes
            left = self.questions.budget - self.questions.spent
            kept = narrowed(self.table, self.best) if settled and left > 0 else None
            if kept is not None:
                best, (candidates, masks) = kept, self.table.candidates()
            else:
                best, candidates, masks = learn_from(self.table)
                if best.mistakes and self.questions.revise(best):
                    continue
            self.best = best
            self.questions.rule = best.rule
            if left <= 0:
                self._without_mistakes()
                return
            settled = best.shape == before
            before = best.shape
            count = 1 if settled else 3
            questions = self._committee(best, candidates, masks, failed, count)
            if self.lines(best) or self.casts(best):
                settled = False
                continue
            narrow = self._thresholds(best)
            members = self._members(best) if settled else []
            calm = 0 if narrow or questions or members else calm + 1
            if calm > 2 and kept is None:
                self._without_mistakes()
                return
            settled = settled and calm <= 2
            if not settled:
                narrow = self.random.sample(narrow, min(1, len(narrow)))
            more = [*members, *self._mirrored(best)] if settled else []
            asked = {"committee": questions, "threshold": [*narrow, *more]}
            if not settled or not questions or not narrow:
                self._owed += 2  # with one variable changed, and with all
            self.questions.ask_at_once({**asked, "explore": self._explorations(sum(map(len, asked.values())))})

    def _explorations(self, beside: int) -> list[Assignment]:
        """Return as many explorations as fill the rounds of trials at once; those that are left are asked later."""
        rounds = max(1, (beside + self._owed) // self.questions.parallelism)
        count = max(0, rounds * self.questions.parallelism - beside)
        self._owed = max(0, self._owed - count)
        explorations = []
        for _ in range(count):
            self._turn = not self._turn
            draws = self.draws
            explorations.append(draws.alone(self.random.choice(self._anchors)) if self._turn else draws.explore())
        return explorations

    def _without_mistakes(self) -> None:
        """Take the simplest rule without mistakes, if there is one: no further trials would show what was wrong."""
        other = consistent(self.table, self.best) if self.best.mistakes else None
        while other is not None:
            self.best, self.questions.rule = other, other.rule
            if not self.ask(self._members(other), "threshold"):
                return
            other = consistent(self.table, other)
            if other is None:  # what was just asked contradicts it
                self.best = learn_from(self.table)[0]
                self.questions.rule = self.best.rule

    def lines(self, best: Learnt) -> bool:
        """Look once for linear features, when no short rule explains what was seen; say whether there are new ones.

        By then rules without coefficients are found. Edges are narrowed in the nominal case whose variables fail alone
        most often, and in one farther from those of integers.
        """
        if self._sought or not _doubtful(best) or self.questions.spent < 0.4 * self.questions.budget:
            return False
        self._sought = True
        base = self._anchors[1]
        edges = self._edges(base)
        farther = farther_base(edges, base, {variable.name: variable.type for variable in self.variables})
        return self.table.include([*linear_features(edges), *linear_features(self._edges(farther) if farther else ())])

    def _edges(self, base: Assignment) -> list[Flip]:
        """Return where the outcome flips if one number leaves a case, as narrow as trials allow; none if it fails."""
        self.ask([base], "threshold")
        known = zip(self.table.assignments, self.table.failed, strict=True)
        if not any(not failed and assignment_key(one) == assignment_key(base) for one, failed in known):
            return []
        types = {variable.name: variable.type for variable in self.variables}
        ends = [
            {**base, name: end(numbers)}
            for name in types
            if types[name] != "bool"
            if (numbers := [x for x in self.sampler.known[name] if isinstance(x, int | float) and math.isfinite(x)])
            for end in (min, max)
        ]
        self.ask(ends, "threshold")
        while True:
            edges = edges_of(self.variables, base, self.table.assignments, self.table.failed)
            if len({edge.name for edge in edges}) < 2:
                return []
            wide = [(edge.name, middle_of(edge, types[edge.name])) for edge in edges if not edge.narrow]
            if not self.ask([{**base, name: value} for name, value in wide if value is not None], "threshold"):
                return edges

    def casts(self, best: Learnt) -> bool:
        """Look once for casts to smaller integers, when no rule of few terms explains what was seen; say if any.

        Casts hold periodically, so a rule of more terms may stand for one; by then enough trials have failed for them.
        """
        plain = not best.mistakes and len(best.terms) <= 2
        if self._cast or plain or self.questions.spent < 0.3 * self.questions.budget:
            return False
        self._cast = True
        found = casts_of({variable.name: variable.type for variable in self.variables})
        self.table.include(found)
        return bool(found)

    def _committee(
        self, best: Learnt, candidates: list[Candidate], masks: Array, failed: Array, count: int
    ) -> list[Assignment]:
        """Return new assignments about which rules learnt from parts of the features disagree most."""
        members = [(best, 2.0)]
        features = sorted({candidate.feature for candidate in candidates})
        used = sorted({candidate.feature for term in best.terms for candidate in term})
        for member in range(4):
            dropped = set(self.random.sample(features, len(features) // 3))
            if used:
                dropped.add(used[member % len(used)])
            keep = [index for index, candidate in enumerate(candidates) if candidate.feature not in dropped]
            if not keep:
                continue
            rival = learn([candidates[index] for index in keep], masks[keep], failed, width=1, beam=16)
            members.append((rival, 1.0 if not rival.mistakes else 0.3 / rival.mistakes))
        # At the limits of the members themselves two rules that are alike, such as hypot and max(abs), differ.
        own = [candidate for learnt, _ in members for term in learnt.terms for candidate in term]
        pool = [*self.draws.pool(), *self.draws.surfaces(candidates), *self.draws.surfaces(list(dict.fromkeys(own)))]
        columns = columns_of(self.variables, pool)
        votes = [learnt.rule.predict(columns) for learnt, _ in members]
        weights = [weight for _, weight in members]
        share = np.average(np.array(votes, dtype=np.float64), axis=0, weights=weights)
        doubt = np.minimum(share, 1 - share)
        order = np.argsort(-doubt, kind="stable")
        return [pool[index] for index in order[:count].tolist() if doubt[index] > 0.01]

    def _thresholds(self, best: Learnt) -> list[Assignment]:
        """Return one narrowing trial per threshold of the best rule; one that terms share counts once."""
        found = []
        shared: set[Candidate] = set()
        for row, term in enumerate(best.terms):
            for column, candidate in enumerate(term):
                if candidate in shared:
                    continue
                key = (candidate.feature, candidate.operator)
                turn = self._turns.get(key, 0)
                place = (row, column)
                question = probe_threshold(self.table, best, place, self.random, turn=turn, known=self.known)
                if question is not None:
                    self._turns[key] = turn + 1
                    shared.add(candidate)
                    found.append(question)
        return found

    def _mirrored(self, best: Learnt) -> list[Assignment]:
        """Return for each threshold of one number, once, a failing trial with the sign changed: it tells x from |x|."""
        columns = self.table.columns
        found: list[Assignment] = []
        for term, rule in zip(best.terms, best.rule.terms, strict=True):
            rows = np.flatnonzero(self.table.outcomes & Rule((rule,)).predict(columns)).tolist()
            for candidate in term:
                (name, *_), key = candidate.feature.args, (candidate.feature, candidate.operator)
                if candidate.feature.kind != "raw" or candidate.operator not in ("<", ">") or key in self._turned:
                    continue
                self._turned.add(key)
                base = self.table.assignments[self.random.choice(rows)] if rows else self._anchors[0]
                value = row_of(self.variables, base)[name]
                moved = changed(self.variables, base, {name: -value}) if isinstance(value, int | float) else None
                if moved is not None and not self.known(moved):
                    found.append(moved)
        return found

    def _members(self, best: Learnt) -> list[Assignment]:
        """Return trials with numbers around each set or small limit of an integer, once, where it alone decides."""
        columns = self.table.columns
        whole = {one.name for one in self.variables if "[" not in one.type and integer_range(one.type) is not None}
        found: list[Assignment] = []
        for term in best.rule.terms:
            for place, literal in enumerate(term):
                members = _counted(literal)
                if not whole.issuperset(literal.feature.args) or (literal.feature, members) in self._completed:
                    continue
                self._completed.add((literal.feature, members))
                if not members:
                    continue
                rest = Rule((term[:place] + term[place + 1 :],)).predict(columns)
                others = Rule(tuple(one for one in best.rule.terms if one is not term)).predict(columns)
                rows = np.flatnonzero(rest & ~others).tolist()
                name, base = literal.feature.args[0], self.table.assignments[self.random.choice(rows or [0])]
                seen = set(columns[name][rows].tolist())
                asked = [value for value in (*members, *around(members)) if value not in seen]
                moved = (changed(self.variables, base, {name: value}) for value in asked)
                found += [one for one in moved if one is not None and not self.known(one)]
        return found

    def validate(self, count: int, context: Sequence[Variable]) -> list[Sample]:
        """Ask fresh cases of the distribution stated in `validation`, half of them inside the rule if possible."""
        near = near_limits(self.table, self.best, self.sampler, self.random, 10 * count)
        drawn = [self.sampler.assignment(self.random) for _ in range(len(near) or 10 * count)]
        pool = [one for one in (*near, *drawn) if not self.known(one)]
        if not pool or count < 1:
            return self._validate_known(count, context)
        inside = self.questions.said(pool)
        self.share = float(inside.mean())
        sides: tuple[dict[object, Assignment], dict[object, Assignment]] = ({}, {})
        for index in self.random.sample(range(len(pool)), len(pool)):
            sides[int(inside[index])][assignment_key(pool[index])] = pool[index]
        rest, hits = (list(side.values()) for side in sides)
        half = min(len(hits), max(count // 2, count - len(rest)))
        chosen = [*hits[:half], *rest[: count - half]]
        self.random.shuffle(chosen)
        varied = chosen[::3] if context else []
        plain = [one for index, one in enumerate(chosen) if index % 3 or not context]
        others = [{**one, **{each.name: self.random.choice(each.nominal) for each in context}} for one in varied]
        return [*self.ask(plain, "validate"), *self.ask(others, "context")]

    def _validate_known(self, count: int, context: Sequence[Variable]) -> list[Sample]:
        """Ask known cases with other values of the context, if variables have few values, as an order does."""
        cases: dict[object, Assignment] = {}
        for turn in range(count):
            one = self.table.assignments[turn % len(self.table.assignments)]
            others = {each.name: self.random.choice(each.nominal) for each in context}
            if any(not same_scalar(others[each.name], each.failing) for each in context):
                cases[assignment_key({**one, **others})] = {**one, **others}
        if cases:
            self.share = float(self.questions.said(cases.values()).mean())
        return self.ask(list(cases.values()), "context")

    def result(self, checked: Sequence[Sample]) -> LearnedRule:
        """Return the rule with what the last validation said about it."""
        predicted = self.questions.said(sample.assignment for sample in checked)
        failed = [sample.failed for sample in checked]
        told = scores(predicted.tolist(), failed, self.share)
        wrong = [sample for sample, said in zip(checked, predicted, strict=True) if bool(said) != sample.failed]
        return LearnedRule(
            self.questions.rule,
            told.precision,
            told.recall,
            told.balanced_accuracy,
            len(checked),
            tuple(self.questions.samples),
            self.questions.trials,
            self.alternatives(),
            sum(sample.phase == "context" for sample in wrong),
            sum(sample.phase == "context" for sample in checked),
        )

    def decide(self) -> bool:
        """Ask about cases on which rules that explain all trials disagree; return whether the rule has been wrong.

        Each answer may leave another such rule, and each time costs a trial for each of them, rarely more than two.
        """
        for _ in range(4):
            asked = self.ask([case for _, _, case in self._rivals()], "decide")
            if not asked or self.questions.mistakes(asked):
                return bool(asked)
        return False

    def alternatives(self) -> tuple[Alternative, ...]:
        """Return short rules without one of this rule's features that explain all trials, but not all other cases."""
        found = sorted(self._rivals(), key=lambda rival: rival[0])
        return tuple(Alternative(rule, row_of(self.variables, case)) for _, rule, case in found[:2])

    def _rivals(self) -> list[tuple[float, Rule, Assignment]]:
        """Return all alternatives, each with its length in bits and a case that decides."""
        failed = self.table.outcomes
        candidates, masks = self.table.candidates()
        pool = [*self.draws.pool(), *self.draws.surfaces(candidates)]
        if not pool or not self.best.terms:
            return []
        columns = columns_of(self.variables, pool)
        said = self.questions.rule.predict(columns)
        found: dict[str, tuple[float, Rule, Assignment]] = {}
        for feature in sorted({candidate.feature for term in self.best.terms for candidate in term}):
            keep = [index for index, candidate in enumerate(candidates) if candidate.feature != feature]
            rival = widen(self.table, learn([candidates[index] for index in keep], masks[keep], failed))
            wrong = rival.rule.predict(self.table.columns) != failed
            if rival.bits > self.best.bits + ERROR_BITS / 2 or wrong.any():
                continue
            differ = np.flatnonzero(rival.rule.predict(columns) != said)
            if len(differ):
                found.setdefault(rival.rule.text(), (rival.bits, rival.rule, pool[int(differ[0])]))
        return list(found.values())
