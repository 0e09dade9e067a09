"""Relevant fields: those whose value decides about the failure, each with a certificate (RIOT II-B b, after HPSL).

Replace all fields not known to be relevant at once by one random draw. Where that changes the outcome, bisect the list
of replaced fields down to two neighbouring trials that differ in one field and in the outcome: its certificate.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from riot_bus.generalize.oracle import Oracle, assignment_key, find_flip, same_scalar, scalar_key
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Ask, Progress, Scalar

__all__ = ["Certificate", "FieldSpace", "Relevance", "RelevantField", "relevant_fields"]

DOUBT = 0.05
"""One minus the confidence of `Relevance.bound`."""

ALTERNATIVE_CAUSES = 8
"""So many fields at most are taken in because they break a passing trial (a unit may crash on any field)."""


@dataclass(frozen=True, slots=True)
class FieldSpace:
    """One field and the values it may take.

    `failing` is its value in the failing log, `nominal` the one before the injection (None when not injected), `draws`
    are replacements (dictionary and observed values), `prior` the weight to be relevant beside others of its kind.
    """

    name: str
    failing: Scalar
    nominal: Scalar | None
    draws: tuple[Scalar, ...]
    prior: float = 1.0


@dataclass(frozen=True, slots=True)
class Certificate:
    """Two assignments of all fields, both asked, that differ in one field alone; one fails and the other passes."""

    failing: Mapping[str, Scalar]
    passing: Mapping[str, Scalar]


@dataclass(frozen=True, slots=True)
class RelevantField:
    """A field that decides about the failure.

    `kind` is "exceptional" when its nominal value heals the failure, "nominal" when the failure needs a value such as
    the nominal one (mode fields) or depends on it together with others.
    """

    name: str
    kind: Literal["exceptional", "nominal"]
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class Relevance:
    """All relevant fields in the order found.

    With 95 % confidence a random draw of all other fields changes the outcome with probability at most `bound`
    (ln(1/0.05) / `straight`, from `straight` draws in a row without a change).
    """

    fields: tuple[RelevantField, ...]
    bound: float
    straight: int
    trials: int


def relevant_fields(
    fields: Sequence[FieldSpace],
    ask: Ask[Mapping[str, Scalar]],
    *,
    seed: int,
    straight: int = 12,
    parallelism: int = 1,
    progress: Progress | None = None,
) -> Relevance:
    """Find the fields that decide about the failure, with a certificate for each.

    Three stages: between the failing and the nominal values of the injected fields; random draws around the failing
    assignment until `straight` in a row still fail; the same around a passing one until `straight` in a row still pass
    (it finds the partner of a field whose exceptional value hides it, such as y in x * y > limit with x = INT_MAX).

    Args:
        fields: All fields of the minimal log, with distinct names.
        ask: Each question assigns a value to every field; True = fails with the same signature.
        seed: Decides all draws.
        straight: Draws in a row without effect that end the search; 0 leaves only the first stage.
        parallelism: Questions worth asking in one batch.
        progress: Told after every batch.

    Raises:
        InconclusiveError: If the failing assignment does not fail.
        ValueError: If two fields have one name.
    """
    search = _Search(fields, ask, seed=seed, parallelism=parallelism, progress=progress)
    search.check()
    search.heal()
    search.resample(straight, failing=True)
    if search.found:
        search.resample(straight, failing=False)
    bound = min(1.0, math.log(1 / DOUBT) / straight) if straight > 0 else 1.0
    return Relevance(tuple(search.found.values()), bound, straight, search.oracle.trials)


class _Search:
    """The state of one run of `relevant_fields`."""

    def __init__(
        self,
        fields: Sequence[FieldSpace],
        ask: Ask[Mapping[str, Scalar]],
        *,
        seed: int,
        parallelism: int,
        progress: Progress | None,
    ) -> None:
        self.fields = {field.name: field for field in fields}
        if len(self.fields) != len(fields):
            raise ValueError("field names must be distinct")
        self.oracle: Oracle[Mapping[str, Scalar]] = Oracle(ask, key=assignment_key, progress=progress)
        self.parallelism = max(1, parallelism)
        self.random = random.Random(seed)  # noqa: S311 - not for secrets
        self.found: dict[str, RelevantField] = {}
        self.failing: dict[str, Scalar] = {field.name: field.failing for field in fields}
        injected = sum(field.nominal is not None for field in fields)
        boost = max(1.0, (len(fields) - injected) / injected) if injected else 1.0
        self.prior = {
            field.name: max(field.prior, 1e-9) * (boost if field.nominal is not None else 1.0) for field in fields
        }
        self.decks: dict[str, list[Scalar]] = {field.name: [] for field in fields}

    def check(self) -> None:
        """Ask whether the failing assignment fails."""
        if not self.oracle.ask([self.failing], "checking the failing values")[0]:
            raise InconclusiveError(
                "the failing log does not fail with this signature, so no field can be called relevant",
                hint="replay it several times; if it fails only sometimes, raise the number of repetitions",
            )

    def heal(self) -> None:
        """Find the injected fields whose nominal value heals; set the others to nominal."""
        while True:
            healed = dict(self.failing)
            for name, field in self.fields.items():
                if field.nominal is not None and name not in self.found:
                    healed[name] = field.nominal
            if self.oracle.ask([healed], "replacing injected values by nominal ones")[0]:
                self.failing = healed
                return
            self._bisect(self.failing, healed, failing=True)

    def resample(self, straight: int, *, failing: bool) -> None:
        """Draw all unknown fields around a failing or passing assignment until `straight` draws have no effect."""
        unchanged, taken = 0, 0
        while unchanged < straight and len(self.found) < len(self.fields):
            count = min(self.parallelism, straight - unchanged)
            bases = [self._base(failing=failing) for _ in range(count)]
            drawn = [self._draw(base) for base in bases]
            answers = self.oracle.ask(drawn, f"resampling {len(self.fields) - len(self.found)} fields")
            for base, end, answer in zip(bases, drawn, answers, strict=True):
                if answer is failing:
                    unchanged += 1
                    continue
                unchanged = 0
                self._exhaust(base, end, failing=failing)
                taken += 1
                break
            if not failing and taken >= ALTERNATIVE_CAUSES:
                return

    def _exhaust(self, base: dict[str, Scalar], end: dict[str, Scalar], *, failing: bool) -> None:
        """Find all fields that one draw shows: hold each found one at its base value and look again."""
        while True:
            name = self._bisect(base, end, failing=failing)
            end = {**end, name: base[name]}
            if self.oracle.ask([end], "looking for another field in the same draw")[0] is failing:
                return

    def _bisect(self, start: dict[str, Scalar], end: dict[str, Scalar], *, failing: bool) -> str:
        """Find one field between two assignments of different outcome (`failing`: that of `start`)."""
        changed = [name for name in self.fields if not same_scalar(start[name], end[name])]
        changed.sort(key=lambda name: -self.prior[name])

        def at(length: int) -> dict[str, Scalar]:
            return {**start, **{name: end[name] for name in changed[:length]}}

        def probe(lengths: Sequence[int]) -> list[bool]:
            answers = self.oracle.ask([at(length) for length in lengths], f"bisecting {len(changed)} fields")
            return [answer is not failing for answer in answers]

        length = find_flip([self.prior[name] for name in changed], probe, low=0, parallelism=self.parallelism)
        name = changed[length - 1]
        pair = (at(length - 1), at(length))
        certificate = Certificate(*pair) if failing else Certificate(pair[1], pair[0])
        nominal = self.fields[name].nominal
        heals = nominal is not None and same_scalar(nominal, certificate.passing[name])
        self.found[name] = RelevantField(name, "exceptional" if heals else "nominal", certificate)
        return name

    def _base(self, *, failing: bool) -> dict[str, Scalar]:
        """Return an asked assignment with the wanted outcome; known relevant fields keep its values."""
        if failing:
            return self.failing
        choice = self.random.choice(list(self.found.values()))
        return dict(choice.certificate.passing)

    def _draw(self, base: Mapping[str, Scalar]) -> dict[str, Scalar]:
        return {name: base[name] if name in self.found else self._deal(name) for name in self.fields}

    def _deal(self, name: str) -> Scalar:
        """Return the field's next replacement value: all come once before one comes again."""
        deck = self.decks[name]
        if not deck:
            field = self.fields[name]
            values = {scalar_key(value): value for value in (*field.draws, field.nominal) if value is not None}
            if len(values) > 1:
                values.pop(scalar_key(field.failing), None)
            deck.extend(values.values() or [field.failing])
            self.random.shuffle(deck)
        return deck.pop()
