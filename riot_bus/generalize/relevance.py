"""Relevant fields: those whose value decides about the failure, each with a certificate (RIOT II-B b, after HPSL).

Replace all fields not known to be relevant at once by one random draw. If that changes the outcome, bisect the list of
replaced fields down to two neighbouring trials that differ in one field and in the outcome: the field's certificate.
Answers may be wrong: "nothing has changed" is one of the hypotheses, and a search ends when one is likely enough.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from riot_bus.generalize.oracle import FAILS, SURE, BudgetSpentError, Trials, assignment_key, same_scalar, scalar_key
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.trial import Ask, Progress

DOUBT = 0.05
"""One minus the confidence of `Relevance.bound`."""

STRAIGHT = 60
"""Draws in a row without effect: with 95 % confidence all other fields change at most ln(20) / 60 = 5 % of outcomes."""

PASSING_STRAIGHT = 12
"""The same around a passing assignment; that stage only looks for further fields, and no claim rests on it."""

BUDGET = 1000
"""Trials at most: enough for three of 5,000 fields, failing three times in ten (about 500)."""


@dataclass(frozen=True, slots=True)
class FieldSpace:
    """One field and the values it may take.

    `failing` is its value in the failing log, `nominal` the one before the injection (None when not injected), `draws`
    are replacements (dictionary and observed values), `observed` are its values in nominal logs.
    """

    name: str
    failing: Scalar
    nominal: Scalar | None
    draws: tuple[Scalar, ...]
    observed: tuple[Scalar, ...] = ()

    def usual(self, value: Scalar) -> bool:
        """Return whether a value is nominal: as before the injection, untouched in the failing log, or observed."""
        own = self.failing if self.nominal is None else self.nominal
        return any(same_scalar(value, one) for one in (own, *self.observed))


@dataclass(frozen=True, slots=True)
class Certificate:
    """Two assignments of all fields, both asked, that differ in one field alone; one fails and the other passes."""

    failing: Mapping[str, Scalar]
    passing: Mapping[str, Scalar]


@dataclass(frozen=True, slots=True)
class RelevantField:
    """A field that decides about the failure.

    `kind` is "nominal" when the value that fails in its certificate is a nominal one (the failure needs it, as with
    mode fields), else "exceptional".
    """

    name: str
    kind: Literal["exceptional", "nominal"]
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class Relevance:
    """All relevant fields in the order found.

    With 95 % confidence a random draw of all other fields changes the outcome with probability at most `bound`
    (ln(1/0.05) / `straight`, from `straight` draws in a row without a change). `complete` says that the search
    ended by itself, not because its trials were spent.
    """

    fields: tuple[RelevantField, ...]
    bound: float
    straight: int
    trials: int
    complete: bool
    noise: Noise


def relevant_fields(
    fields: Sequence[FieldSpace],
    ask: Ask[Mapping[str, Scalar]],
    *,
    seed: int,
    straight: int = STRAIGHT,
    noise: Noise | None = None,
    budget: int = BUDGET,
    parallelism: int = 1,
    progress: Progress | None = None,
) -> Relevance:
    """Find the fields that decide about the failure, with a certificate for each.

    Three stages: between the failing and the nominal values of the injected fields; random draws around the failing
    assignment until `straight` in a row still fail; the same around a passing one until `PASSING_STRAIGHT` in a row
    still pass (it finds the partner of a field whose exceptional value hides it, such as y in x * y > limit with
    x = INT_MAX).

    Each question assigns a value to every field, and is each time a fresh trial; True = failed with the same signature.
    Once the budget of trials is spent, the fields found so far are the result.

    Raises:
        InconclusiveError: If the failing assignment does not fail.
        ValueError: If two fields have one name.
    """
    trials: Trials[Mapping[str, Scalar]] = Trials(
        ask, key=assignment_key, noise=noise, budget=budget, parallelism=parallelism, progress=progress
    )
    search = _Search(fields, trials, seed=seed)
    complete = True
    try:
        what, so = "the failing log", "no field can be called relevant"
        doing = "checking the failing values"
        trials.require(search.failing, prior=FAILS, doubt=DOUBT, doing=doing, what=what, so=so)
        search.heal()
        search.resample(straight, failing=True)
        if search.found:
            search.resample(PASSING_STRAIGHT, failing=False)
        while search.drop_unconfirmed() or (straight and search.unsettled):
            search.resample(straight, failing=True)
    except BudgetSpentError:
        complete = False
    bound = min(1.0, math.log(1 / DOUBT) / search.straight) if search.straight else 1.0
    return Relevance(tuple(search.found.values()), bound, search.straight, trials.spent, complete, trials.noise)


def _still(unchanged: int) -> float:
    """Return the probability that one more draw changes nothing, after so many in a row without effect.

    Before the first one, it is as likely as not that no field is left; if one is, all shares of draws are as likely.
    """
    return (unchanged + 1) * (unchanged + 3) / (unchanged + 2) ** 2


class _Search:
    """The state of one run of `relevant_fields`."""

    def __init__(self, fields: Sequence[FieldSpace], trials: Trials[Mapping[str, Scalar]], *, seed: int) -> None:
        self.fields = {field.name: field for field in fields}
        if len(self.fields) != len(fields):
            raise ValueError("field names must be distinct")
        self.trials = trials
        self.random = random.Random(seed)  # noqa: S311 - not for secrets
        self.straight = 0
        self.found: dict[str, RelevantField] = {}
        self.failing: dict[str, Scalar] = {field.name: field.failing for field in fields}
        injected = sum(field.nominal is not None for field in fields)
        boost = max(1.0, (len(fields) - injected) / injected) if injected else 1.0
        self.prior = {field.name: boost if field.nominal is not None else 1.0 for field in fields}
        self.decks: dict[str, list[Scalar]] = {field.name: [] for field in fields}

    def heal(self) -> None:
        """Find the injected fields whose nominal value heals; set the others to nominal."""
        while True:
            healed = dict(self.failing)
            for name, field in self.fields.items():
                if field.nominal is not None and name not in self.found:
                    healed[name] = field.nominal
            if assignment_key(healed) == assignment_key(self.failing):
                return
            (answer,) = self.trials.ask([healed], "replacing injected values by nominal ones")
            before = self.failing
            if self._flip(before, healed, failing=True, answer=answer, unchanged=0.5) is None:
                if self.failing is before:  # else what led to it was wrong, and it has been healed anew
                    self.failing = healed
                    # Their exceptional values have no effect, so they are no likelier than other fields any more.
                    self.prior = dict.fromkeys(self.fields, 1.0)
                return

    def resample(self, straight: int, *, failing: bool) -> None:
        """Draw all unknown fields around a failing or passing assignment until `straight` draws have no effect."""
        unchanged, taken = 0, 0
        doing = f"resampling fields around {'failing' if failing else 'passing'} values"
        while unchanged < straight and len(self.found) < len(self.fields) and (failing or self.found):
            bases = [self._base(failing=failing) for _ in range(min(self.trials.parallelism, straight - unchanged))]
            drawn = [self._draw(base) for base in bases]
            answers = self.trials.ask(drawn, doing)
            for base, end, answer in zip(bases, drawn, answers, strict=False):
                shown = self._shows(base, end, answer=answer, failing=failing, prior=_still(unchanged))
                # What is left of a draw, once the fields that it shows are held, is one without effect.
                unchanged, taken = (1 if shown else unchanged + 1), taken + shown
                if failing and (
                    base is not self.failing or (unchanged >= min(15, straight) and self.drop_unconfirmed())
                ):
                    unchanged = 0
                if failing:
                    self.straight = unchanged
                if shown or not unchanged:
                    break
            if not failing and taken >= 8:  # a unit may crash on any field
                return

    @property
    def unsettled(self) -> bool:
        """Whether other fields are left of which nothing is known, since those that were held have changed."""
        return not self.straight and len(self.found) < len(self.fields)

    def drop_unconfirmed(self) -> bool:
        """Ask again for certificates in doubt at the rates known by now; say whether any was dropped."""
        dropped = False
        for name, field in list(self.found.items()):
            sides, doing = (field.certificate.failing, field.certificate.passing), "confirming certificates"
            for side, prior in zip(sides, (0.8, 0.2), strict=True):
                (chance,) = self.trials.triggers([side], prior=prior, doubt=0.02, doing=doing)
                if (chance > 0.5) is not (prior > 0.5):
                    del self.found[name]
                    dropped, self.straight = True, 0
                    break
        return dropped

    def _shows(
        self, base: dict[str, Scalar], end: dict[str, Scalar], *, answer: bool, failing: bool, prior: float
    ) -> bool:
        """Find all fields that one draw shows; hold each found one at its base value and look again."""
        shown = False
        while failing or answer:  # around passing values, a trial that passes is taken for no change
            name = self._flip(base, end, failing=failing, answer=answer, unchanged=prior)
            if name is None:
                break
            shown, prior = True, 0.5
            end = {**end, name: base[name]}
            (answer,) = self.trials.ask([end], "looking for another field in the same draw")
        return shown

    def _flip(
        self, start: dict[str, Scalar], end: dict[str, Scalar], *, failing: bool, answer: bool, unchanged: float
    ) -> str | None:
        """Find one field between two assignments whose outcomes differ; None if they do not.

        Whether `start` triggers the failure is known, and one trial of `end`; `unchanged`: the prior of no difference.
        """
        changed = [name for name in self.fields if not same_scalar(start[name], end[name])]
        if not changed:
            return None
        changed.sort(key=lambda name: -self.prior[name])
        told = [(len(changed), answer)]
        # A draw has no effect once it has failed: while that is likelier than a change, it is asked again.
        while failing and not answer and self.trials.noise.triggers(0, len(told), prior=unchanged) > 0.5:
            copies = [end] * max(1, round(1 / self.trials.noise.rate))
            answers = self.trials.ask(copies, "asking a draw again")
            told += [(len(changed), one) for one in answers]
            answer = any(answers)

        def at(length: int) -> dict[str, Scalar]:
            return {**start, **{name: end[name] for name in changed[:length]}}

        masses = [self.prior[name] for name in changed]
        total = sum(masses)
        masses = [0.01 * total, *masses, total * unchanged / (1 - unchanged)]
        doing = f"bisecting {len(changed)} fields"
        length = self.trials.flip(masses, at, rises=not failing, sure=SURE, doing=doing, told=told)
        if length == 0:
            self._disown(start, failing=failing)
        if not 0 < length <= len(changed):
            return None
        name, pair = changed[length - 1], (at(length - 1), at(length))
        certificate = Certificate(*pair) if failing else Certificate(pair[1], pair[0])
        usual = self.fields[name].usual(certificate.failing[name])
        self.found[name] = RelevantField(name, "nominal" if usual else "exceptional", certificate)
        return name

    def _disown(self, start: dict[str, Scalar], *, failing: bool) -> None:
        """Undo the step that led to a start with the wrong outcome: nominal values that do heal, or a certificate."""
        self.straight = 0
        if failing:
            self.failing = {field.name: field.failing for field in self.fields.values()}
            self.heal()
            return
        key = assignment_key(start)
        wrong = [name for name, one in self.found.items() if assignment_key(one.certificate.passing) == key]
        for name in wrong:
            del self.found[name]

    def _base(self, *, failing: bool) -> dict[str, Scalar]:
        """Return an asked assignment with the wanted outcome; known relevant fields keep its values."""
        if failing:
            return self.failing
        choice = self.random.choice(list(self.found.values()))
        return dict(choice.certificate.passing)

    def _draw(self, base: Mapping[str, Scalar]) -> dict[str, Scalar]:
        return {name: base[name] if name in self.found else self._deal(name) for name in self.fields}

    def _deal(self, name: str) -> Scalar:
        """Return the field's next replacement value: all are used once before any is repeated."""
        deck = self.decks[name]
        if not deck:
            field = self.fields[name]
            values = {scalar_key(value): value for value in (*field.draws, field.nominal) if value is not None}
            if len(values) > 1:
                values.pop(scalar_key(field.failing), None)
            deck.extend(values.values() or [field.failing])
            self.random.shuffle(deck)
        return deck.pop()
