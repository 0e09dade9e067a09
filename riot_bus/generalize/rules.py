"""Extrapolation: the rule over the relevant fields that says when the failure happens (RIOT II-B c).

Trials around the failing and the passing values, then active learning: learn a small DNF over derived features, ask
where a committee of such rules disagrees, put thresholds between ever closer trials, and validate on fresh trials.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

import numpy as np

from riot_bus.generalize.beam import Learnt, learn, learn_guarded
from riot_bus.generalize.edges import Flip, edges_of, farther_base, linear_features, middle_of
from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import casts_of
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.oracle import WAVES, assignment_key, same_scalar
from riot_bus.generalize.refine import around, decisive, inversions, narrowed, probe_threshold, widen
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import (
    Assignment,
    Sampler,
    Variable,
    changed,
    columns_of,
    fitted,
    integer_range,
    row_of,
)
from riot_bus.generalize.table import Candidate, Table, concrete
from riot_bus.generalize.validation import Estimate, near_limits, scores
from riot_bus.vocabulary.elements import Setting
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.trial import Ask, Progress

COMMITTEE = 4
POOL = 240
SURFACES = 60
CONDITIONS = 3
VALIDATIONS = 3
MORE = 2
"""After a validation that shows mistakes, the budget grows by the initial one divided by this."""
DOUBTFUL_BITS = 22.0
"""A rule of two plain thresholds is shorter than this; longer ones may stand for a linear feature."""
ALTERNATIVE_BITS = 6.0
"""A rule that is longer by more than this, half of what one wrong sample costs, is no alternative."""
DECISIONS = 4
"""Largest number of times that a rule is compared with its alternatives: each answer may leave another one, and each
time costs a trial for each of them, rarely more than two."""
MOST_PLAIN_TERMS = 2
"""A rule of more terms may stand for a cast, whose comparisons hold periodically."""
GUESSED = ("explore",)
"""Phases whose answers the rule may predict: not those where rules disagree or at limits, nor those that judge it."""
_REPEATED = 3
"""How often a case that a rule gets wrong counts in addition: three or four literals more are worth it."""
_SMALL = 16
"""A limit of whole numbers up to this may be one of an enumeration, which goes on, or has gaps, beyond it."""
_EXPLORED = 2
"""Explorations for each time that the rule is learnt: with one variable changed, and with all."""
FAILS = 0.98
"""Prior that the failing values fail: the log was minimised with them."""
REVISED = 8
"""Maximum number of samples that a rule gets wrong and that are asked again at once; with more, the rule is wrong."""
MOST_REVISIONS = 40
"""Maximum number of revisions; more trials would not resolve what is still in doubt."""
DOUBT = 0.06
"""A rule is always expected to be wrong in at least one of sixteen new questions, so each takes a few trials."""
CASTS_AFTER = 0.3
"""Casts are sought after this share of the budget: by then enough trials have failed to distinguish so many terms."""
LINES_AFTER = 0.4
"""Edges are sought after this part of the budget: rules without coefficients are found by then."""


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

    search = _Search(variables, ask, expecting, told, seed=seed, budget=budget, parallelism=max(1, parallelism))
    with _one_thread():
        search.start()
        checked: list[Sample] = []
        for left in reversed(range(VALIDATIONS)):
            search.refine()
            while search.settle():
                search.refine()
            checked = search.validate(validation, context)
            if checked and search.revise(search.best):
                checked = search.samples[-len(checked) :]
            # more trials of these variables cannot show what the context does
            wrong = search.mistakes([sample for sample in checked if sample.phase != "context"])
            # a rule that a decision changes needs another validation
            if not wrong and not (left and validation and search.decide()):
                break
            search.budget += budget // MORE
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
        for literal in list(literals)[:CONDITIONS]:
            more, held = table.conditional(concrete(literal).holds(columns))
            candidates, masks = [*candidates, *more], np.vstack([masks, held])
        more_of = learn(candidates, masks, failed)
        widened.append(widen(table, more_of))
        widened.append(widen(table, learn_guarded(candidates, masks, failed, more_of)))
    return min(widened, key=lambda one: one.bits), candidates, masks


def consistent(table: Table, learnt: Learnt) -> Learnt | None:
    """Return a rule, or the one that is given, that gets no trial wrong; None if none is found.

    Seldom cases cost less than the literals that they need; each counts several times here.
    """
    failed = table.outcomes
    columns = table.columns
    again = np.flatnonzero(learnt.rule.predict(columns) != failed).repeat(_REPEATED)
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
    """The state of one run of `learn_rule`."""

    def __init__(
        self,
        variables: Sequence[Variable],
        ask: Ask[Mapping[str, Setting]],
        expecting: AskExpecting | None,
        told: Callable[[int, str], None],
        *,
        seed: int,
        budget: int,
        parallelism: int,
    ) -> None:
        self.variables = tuple(variables)
        self._plain = ask
        self._expecting = expecting
        self._told = told
        self._asked: set[Hashable] = set()
        self.budget = budget
        self.parallelism = parallelism
        self.random = random.Random(seed)  # noqa: S311 - not for secrets
        self.sampler = Sampler(variables)
        self.table = Table(variables)
        self.samples: list[Sample] = []
        self.spent = 0
        self.best = Learnt((), 0.0, 0)
        self.rule = Rule(())
        self.share = 0.0
        self.guesses = self.wrong_guesses = self.revisions = 0
        self.owed, self.turn = 0, False
        self.sought = self.cast = False
        self.turns: dict[object, int] = {}
        self.mirrored: set[object] = set()
        self.completed: set[object] = set()
        self.anchors: list[dict[str, Setting]] = []
        self.decks: dict[object, list[dict[str, Setting]]] = {}

    # -- asking ---------------------------------------------------------------------------------------------------

    def ask(self, questions: Sequence[Assignment], phase: str) -> list[Sample]:
        """Ask what was not asked yet (within the budget, validation aside) and learn the outcomes."""
        return self.ask_at_once({phase: questions})

    def ask_at_once(self, questions: Mapping[str, Sequence[Assignment]]) -> list[Sample]:
        """Ask questions of several phases, which then share batches; see `ask`."""
        fresh: dict[Hashable, tuple[Assignment, str]] = {}
        for phase, ones in questions.items():
            for one in ones:
                if not self._known(one):
                    fresh.setdefault(assignment_key(one), (one, phase))
        new = list(fresh.values())
        if not questions.keys() & {"validate", "context", "decide"}:
            new = new[: max(0, self.budget - self.spent)]
            self.spent += len(new)
        asked: list[Sample] = []
        guessed = not questions.keys().isdisjoint(GUESSED)
        at_once = (1 if guessed else WAVES) * self.parallelism  # what was wrong changes further guesses
        for first in range(0, len(new), at_once):
            batch = new[first : first + at_once]
            guesses = self._guesses(batch)
            assignments = [one for one, _ in batch]
            answers = self._expecting(assignments, guesses) if self._expecting else self._plain(assignments)
            if len(answers) != len(batch):
                raise InconclusiveError(f"{len(batch)} trials were asked for, but {len(answers)} outcomes came back")
            for (one, phase), guess, answer in zip(batch, guesses, answers, strict=True):
                asked.append(Sample(one, bool(answer), phase))
                if self.rule.terms and phase in GUESSED:
                    self.guesses += 1
                    self.wrong_guesses += (guess > 0.5) != asked[-1].failed
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
        return self._change([n for n, one in enumerate(self.samples) if one.failed != said[n]][:REVISED])

    def settle(self) -> bool:
        """Ask again what the rule depends on, if answers may be wrong; return whether any answer has changed."""
        rows = [n for n, one in enumerate(self.samples) if one.phase != "context"]
        columns = columns_of(self.variables, [self.samples[n].assignment for n in rows])
        failed = np.array([self.samples[n].failed for n in rows], dtype=bool)
        return bool(self.rule.terms) and self._change([rows[n] for n in decisive(self.rule, columns, failed)])

    def _change(self, numbers: Sequence[int]) -> bool:
        """Ask for samples as if the opposite of their answers were likely; return whether any answer has changed."""
        if self._expecting is None or self.revisions >= MOST_REVISIONS:
            return False
        self.revisions += 1
        guesses = [DOUBT if self.samples[n].failed else 1 - DOUBT for n in numbers]
        answers = self._expecting([self.samples[n].assignment for n in numbers], guesses) if numbers else ()
        changed = [n for n, answer in zip(numbers, answers, strict=True) if bool(answer) != self.samples[n].failed]
        rows = [n for n, one in enumerate(self.samples) if one.phase != "context"]
        for n in changed:
            self.samples[n] = replace(self.samples[n], failed=not self.samples[n].failed)
            if self.samples[n].phase != "context":
                self.table.failed[rows.index(n)] = self.samples[n].failed
        return bool(changed)

    def _said(self, assignments: Iterable[Assignment]) -> Array:
        """Return for each assignment whether the present rule predicts the failure."""
        return self.rule.predict(columns_of(self.variables, list(assignments)))

    def _guesses(self, questions: Sequence[tuple[Assignment, str]]) -> list[float]:
        """Return how likely questions are to fail, by the rule and by how often it has been right before."""
        if not self._asked:
            return [FAILS]
        if not self.rule.terms:
            return [0.5] * len(questions)
        doubt = min(0.5, max(DOUBT, (self.wrong_guesses + 1) / (self.guesses + 2)))
        chances = [1 - doubt if fails else doubt for fails in self._said(one for one, _ in questions)]
        return [chance if phase in GUESSED else 0.5 for chance, (_, phase) in zip(chances, questions, strict=True)]

    def _known(self, question: Assignment) -> bool:
        return assignment_key(question) in self._asked

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
            if not self._known(card):
                return card
        return self._explore()

    def _nominal(self) -> dict[str, Setting]:
        return {
            variable.name: self.random.choice(variable.nominal or variable.passing or (variable.failing,))
            for variable in self.variables
        }

    # -- learning -------------------------------------------------------------------------------------------------

    def refine(self) -> None:
        """Learn and ask until the committee agrees and every threshold is exact, or the budget is spent."""
        calm = 0
        before: object = None
        settled = False
        while True:
            failed = self.table.outcomes
            kept = narrowed(self.table, self.best) if settled and self.spent < self.budget else None
            if kept is not None:
                best, (candidates, masks) = kept, self.table.candidates()
            else:
                best, candidates, masks = learn_from(self.table)
                if best.mistakes and self.revise(best):
                    continue
            self.best = best
            self.rule = best.rule
            if self.spent >= self.budget:
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
                self.owed += _EXPLORED
            self.ask_at_once({**asked, "explore": self._explorations(sum(map(len, asked.values())))})

    def _explorations(self, beside: int) -> list[Assignment]:
        """Return as many explorations as fill the rounds of trials at once; those that are left are asked later."""
        rounds = max(1, (beside + self.owed) // self.parallelism)
        count = max(0, rounds * self.parallelism - beside)
        self.owed = max(0, self.owed - count)
        explorations = []
        for _ in range(count):
            self.turn = not self.turn
            explorations.append(self._alone(self.random.choice(self.anchors)) if self.turn else self._explore())
        return explorations

    def _without_mistakes(self) -> None:
        """Take the simplest rule without mistakes, if there is one: no further trials would show what was wrong."""
        other = consistent(self.table, self.best) if self.best.mistakes else None
        while other is not None:
            self.best, self.rule = other, other.rule
            if not self.ask(self._members(other), "threshold"):
                return
            other = consistent(self.table, other)
            if other is None:  # what was just asked contradicts it
                self.best = learn_from(self.table)[0]
                self.rule = self.best.rule

    def lines(self, best: Learnt) -> bool:
        """Look once for linear features, when no short rule explains what was seen; say whether there are new ones.

        Edges are narrowed in the nominal case whose variables fail alone most often, and in one farther from those of
        integers.
        """
        if self.sought or not _doubtful(best) or self.spent < LINES_AFTER * self.budget:
            return False
        self.sought = True
        base = self.anchors[1]
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
        """Look once for casts to smaller integers, when no rule of few terms explains what was seen; say if any."""
        plain = not best.mistakes and len(best.terms) <= MOST_PLAIN_TERMS
        if self.cast or plain or self.spent < CASTS_AFTER * self.budget:
            return False
        self.cast = True
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
        for member in range(COMMITTEE):
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
        pool = [*self._pool(), *self._surfaces(candidates), *self._surfaces(list(dict.fromkeys(own)))]
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
                turn = self.turns.get(key, 0)
                place = (row, column)
                question = probe_threshold(self.table, best, place, self.random, turn=turn, known=self._known)
                if question is not None:
                    self.turns[key] = turn + 1
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
                if candidate.feature.kind != "raw" or candidate.operator not in ("<", ">") or key in self.mirrored:
                    continue
                self.mirrored.add(key)
                base = self.table.assignments[self.random.choice(rows)] if rows else self.anchors[0]
                value = row_of(self.variables, base)[name]
                moved = changed(self.variables, base, {name: -value}) if isinstance(value, int | float) else None
                if moved is not None and not self._known(moved):
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
                if not whole.issuperset(literal.feature.args) or (literal.feature, members) in self.completed:
                    continue
                self.completed.add((literal.feature, members))
                if not members:
                    continue
                rest = Rule((term[:place] + term[place + 1 :],)).predict(columns)
                others = Rule(tuple(one for one in best.rule.terms if one is not term)).predict(columns)
                rows = np.flatnonzero(rest & ~others).tolist()
                name, base = literal.feature.args[0], self.table.assignments[self.random.choice(rows or [0])]
                seen = set(columns[name][rows].tolist())
                asked = [value for value in (*members, *around(members)) if value not in seen]
                moved = (changed(self.variables, base, {name: value}) for value in asked)
                found += [one for one in moved if one is not None and not self._known(one)]
        return found

    def _pool(self) -> list[Assignment]:
        """Return new assignments: draws from the mixture, and known samples with one or two variables redrawn."""
        pool: list[Assignment] = [self.sampler.assignment(self.random) for _ in range(POOL // 2)]
        bad = [one for one, failed in zip(self.table.assignments, self.table.failed, strict=True) if failed]
        for _ in range(POOL // 2):
            source = bad if self.random.random() < 0.5 else self.table.assignments
            redrawn = dict(self.random.choice(source))
            for variable in self.random.sample(self.variables, 1 if len(self.variables) < 3 else 2):
                redrawn[variable.name] = self.sampler.value(variable, self.random)
            pool.append(redrawn)
        return [assignment for assignment in pool if not self._known(assignment)]

    def _surfaces(self, candidates: Sequence[Candidate]) -> list[Assignment]:
        """Return new assignments at the thresholds of features of several variables, seldom met by chance."""
        several = [one for one in candidates if len(one.feature.args) > 1 and isinstance(one.inside, int | float)]
        found: list[Assignment] = []
        for candidate in self.random.sample(several, min(SURFACES, len(several))):
            base = self.random.choice(self.table.assignments) if self.random.random() < 0.5 else self._nominal()
            assert isinstance(candidate.inside, int | float)
            if not math.isfinite(candidate.inside):
                continue
            row = row_of(self.variables, base)
            change = self.random.choice(inversions(candidate.feature, row, candidate.inside) or [{}])
            moved = changed(self.variables, base, dict(change))
            if moved is not None:
                found.append(moved)
        return [assignment for assignment in found if not self._known(assignment)]

    def _explore(self) -> Assignment:
        pool = self._pool()
        return pool[0] if pool else self.sampler.assignment(self.random)

    # -- validation -----------------------------------------------------------------------------------------------

    def validate(self, count: int, context: Sequence[Variable]) -> list[Sample]:
        """Ask fresh cases of the distribution stated in `validation`, half of them inside the rule if possible."""
        near = near_limits(self.table, self.best, self.sampler, self.random, 10 * count)
        drawn = [self.sampler.assignment(self.random) for _ in range(len(near) or 10 * count)]
        pool = [one for one in (*near, *drawn) if not self._known(one)]
        if not pool or count < 1:
            return self._validate_known(count, context)
        inside = self._said(pool)
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
            self.share = float(self._said(cases.values()).mean())
        return self.ask(list(cases.values()), "context")

    def mistakes(self, checked: Sequence[Sample]) -> int:
        """Return how many samples the present rule gets wrong."""
        said = self._said(sample.assignment for sample in checked)
        return sum(bool(one) != sample.failed for one, sample in zip(said, checked, strict=True))

    def result(self, checked: Sequence[Sample]) -> LearnedRule:
        """Return the rule with what the last validation said about it."""
        predicted = self._said(sample.assignment for sample in checked)
        failed = [sample.failed for sample in checked]
        told = scores(predicted.tolist(), failed, self.share)
        wrong = [sample for sample, said in zip(checked, predicted, strict=True) if bool(said) != sample.failed]
        return LearnedRule(
            self.rule,
            told.precision,
            told.recall,
            told.balanced_accuracy,
            len(checked),
            tuple(self.samples),
            len(self._asked),
            self.alternatives(),
            sum(sample.phase == "context" for sample in wrong),
            sum(sample.phase == "context" for sample in checked),
        )

    def decide(self) -> bool:
        """Ask about cases on which rules that explain all trials disagree; return whether the rule has been wrong."""
        for _ in range(DECISIONS):
            asked = self.ask([case for _, _, case in self._rivals()], "decide")
            if not asked or self.mistakes(asked):
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
        pool = [*self._pool(), *self._surfaces(candidates)]
        if not pool or not self.best.terms:
            return []
        columns = columns_of(self.variables, pool)
        said = self.rule.predict(columns)
        found: dict[str, tuple[float, Rule, Assignment]] = {}
        for feature in sorted({candidate.feature for term in self.best.terms for candidate in term}):
            keep = [index for index, candidate in enumerate(candidates) if candidate.feature != feature]
            rival = widen(self.table, learn([candidates[index] for index in keep], masks[keep], failed))
            wrong = rival.rule.predict(self.table.columns) != failed
            if rival.bits > self.best.bits + ALTERNATIVE_BITS or wrong.any():
                continue
            differ = np.flatnonzero(rival.rule.predict(columns) != said)
            if len(differ):
                found.setdefault(rival.rule.text(), (rival.bits, rival.rule, pool[int(differ[0])]))
        return list(found.values())
