"""Activation: external values that make the failure happen in the whole system (RIOT II-D).

First, each field is changed alone (`riot_bus.backchain.coordinates`). Then search methods take turns on one shared
history, by default Nelder-Mead, expected improvement of a forest surrogate, and CMA-ES, and fields also vary in time
(`riot_bus.backchain.varied`). Inputs that are refused only tell the search to come back to accepted ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Protocol

import numpy as np

from riot_bus.backchain.coordinates import CoordinateSearch
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.fir import Floats
from riot_bus.backchain.proposers import PORTFOLIO, History, Proposer, SearchMethod, proposers
from riot_bus.backchain.varied import Dimension, Recombination
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.trial import Progress

_PROBES = (-0.2, 0.2, -0.35, 0.35)
"""Steps of a field, as shares of its encoded range, that are combined with those of others on a plateau."""
_REPEATS = 30  # a guess: so often a known point may be proposed before a search gives up
_FAR = 1e100  # its square is finite


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Outcome of one system run.

    Attributes:
        distance: Smallest distance to the rule over the run; None when the internal fields were never seen.
    """

    distance: float | None
    failed: bool


@dataclass(frozen=True, slots=True)
class Activation:
    """How a search ended.

    Attributes:
        found: External values at which the failure happened; None when it did not.
        best_distance: Smallest distance seen; None when the internal fields were never seen.
    """

    found: Mapping[str, float] | None
    runs: int
    best_distance: float | None
    history: tuple[tuple[Mapping[str, float], Evaluation], ...]

    @property
    def text(self) -> str:
        """One line for people."""
        if self.found is not None:
            return self.with_inputs(", ".join(f"{name} = {value:g}" for name, value in self.found.items()))
        if self.best_distance is None:
            return f"not activated in {counted(self.runs, 'run')}: the internal fields were never seen"
        met = sum(one.distance is not None and one.distance <= 0 for _, one in self.history)
        if met:
            return f"not activated in {counted(self.runs, 'run')}, though the rule was met in {met} of them"
        return f"not activated in {counted(self.runs, 'run')}: the rule came no nearer than {self.best_distance:g}"

    def followed_by(self, other: Activation) -> Activation:
        """Return the result of this search, which found nothing, together with the next one's."""
        near = [one for one in (self.best_distance, other.best_distance) if one is not None]
        return Activation(other.found, self.runs + other.runs, min(near, default=None), self.history + other.history)

    def with_inputs(self, text: str) -> str:
        """Return the line for people if inputs were found, which `text` names as the user knows them."""
        return f"activated after {counted(self.runs, 'run')} with {text}"


class SharedHistory(Protocol):
    """History by which several searches share the outcomes of their runs."""

    def add(
        self, points: Sequence[Mapping[str, float]], evaluations: Iterable[Evaluation], fields: Sequence[SearchField]
    ) -> None:
        """Add runs of this search: points, their evaluations, and the fields that points name."""
        ...

    def take(self) -> Sequence[tuple[Mapping[str, float], Evaluation]]:
        """Return the runs of other searches that this one has not received yet: points and evaluations."""
        ...


def activate(
    fields: Sequence[SearchField],
    evaluate: Callable[[Sequence[Mapping[str, float]]], Sequence[Evaluation]],
    *,
    seed: int,
    budget: int = 200,
    parallelism: int = 1,
    methods: Sequence[SearchMethod] = PORTFOLIO,
    families: Sequence[Sequence[Dimension]] = (),
    promising: Sequence[Mapping[str, float]] = (),
    progress: Progress | None = None,
    shared: SharedHistory | None = None,
) -> Activation:
    """Search for external values that make the failure happen (RIOT II-D).

    Deterministic for equal seeds and evaluations, unless `shared` is given. No point is evaluated twice.

    `evaluate` runs the system once per point, in order. Best give only fields that permeability has left. `families`
    are ways in which fields vary in time, which are tried after constant ones; `promising` points failed in other runs:
    a few are tried first, if within the ranges of fields, with other fields at their usual values. Runs of others in
    the `shared` history only guide this search, and points that failed there are tried first.

    Raises:
        ConfigError: All methods need more fields, and the star probes did not suffice.
        ValueError: There are no fields, two have one name, or a number is not positive.
        MissingExtraError: scikit-learn or cmaes is not installed and the star probes did not suffice.
    """
    if not fields or len({field.name for field in fields}) < len(fields):
        raise ValueError("activation needs at least one field, and different names")
    if budget < 1 or parallelism < 1:
        raise ValueError(f"budget and parallelism must be positive, not {budget} and {parallelism}")
    search = _Turns(
        _Search([Dimension(each, at) for at, each in enumerate(fields)], (seed,), methods), families, seed, methods
    )
    elsewhere = ({each.name: one.get(each.name, each.usual) for each in fields} for one in promising)
    allowed = (one for one in elsewhere if all(each.low <= one[each.name] <= each.high for each in fields))
    for one in islice(allowed, 4):  # each costs a run, and if none of these fails, others hardly will
        search.promise(one)
    history: list[tuple[Mapping[str, float], Evaluation]] = []
    known = [*fields, *(each.search for family in families for each in family)]
    while len(history) < budget:
        for point, evaluation in shared.take() if shared is not None else ():
            search.learn(point, evaluation)
        batch = search.batch(min(parallelism, budget - len(history)))
        if not batch:
            break
        points = [wanted.point for wanted in batch]
        evaluations = evaluate(points)
        history += zip(points, evaluations, strict=True)
        if shared is not None:
            shared.add(points, evaluations, known)
        best = _nearest(history)
        if progress is not None:
            near = "no distance yet" if best is None else f"nearest {best:.3g}"
            progress(len(history), budget, f"activation, {near}")
        failing = [point for point, evaluation in zip(points, evaluations, strict=True) if evaluation.failed]
        if failing:
            return Activation(failing[0], len(history), best, tuple(history))
        for wanted, evaluation in zip(batch, evaluations, strict=True):
            search.tell(wanted, evaluation.distance)
    return Activation(None, len(history), _nearest(history), tuple(history))


def _nearest(history: Sequence[tuple[Mapping[str, float], Evaluation]]) -> float | None:
    distances = [evaluation.distance for _, evaluation in history if evaluation.distance is not None]
    return min((distance for distance in distances if not math.isnan(distance)), default=None)


@dataclass(frozen=True, slots=True)
class _Proposal:
    """A new point, its vector, and the methods that wait for its answer (each under its own vector)."""

    point: Mapping[str, float]
    vector: Floats
    askers: list[tuple[Proposer, Floats]] = field(default_factory=list)


class _Turns:
    """Turns of the searches for constant and for varying fields: every other one goes to the nearest search so far.

    Before that, each search has six runs.
    """

    def __init__(
        self, constant: _Search, families: Sequence[Sequence[Dimension]], seed: int, methods: Sequence[SearchMethod]
    ) -> None:
        self._searches = [constant]
        self._families = list(families)
        self._seed, self._methods = seed, methods
        self._asked = constant
        self._turn = 0
        self._promised: list[Mapping[str, float]] = []

    def learn(self, point: Mapping[str, float], evaluation: Evaluation) -> None:
        """Take a run of another search: a point that failed is tried next, one that varies in time is ignored."""
        constant = self._searches[0]
        if point.keys() != {field.name for field in constant.encoding.fields} or constant.knows(point):
            return
        if evaluation.failed:
            self.promise(point)
        else:
            constant.learn(point, evaluation.distance)

    def promise(self, point: Mapping[str, float]) -> None:
        """Queue a point to be tried next."""
        if point not in self._promised:
            self._promised.append(point)

    def batch(self, size: int) -> list[_Proposal]:
        """Return up to `size` new points, all of one search; none when the spaces of all are exhausted.

        Constant fields have the first turns, until each was changed alone.
        """
        constant = self._searches[0]
        self._promised = [point for point in self._promised if not constant.knows(point)]
        if self._promised:
            some, self._promised = self._promised[:size], self._promised[size:]
            self._asked = constant
            return [_Proposal(point, constant.encoding.encode(point)) for point in some]
        if self._families and (found := constant.lines(size)):
            return found
        for number, family in enumerate(self._families):
            tried = constant.ranked() or [constant.encoding.nominal]
            self._searches.append(_Search(family, (self._seed, 1 + number), self._methods, tried))
        self._families = []
        self._turn += 1
        order = sorted(
            self._searches,
            key=lambda each: (each.runs >= 6, each.nearest if self._turn % 2 else 0.0, each.runs),
        )
        for each in order:
            if found := each.batch(size):
                self._asked = each
                return found
        return []

    def tell(self, wanted: _Proposal, distance: float | None) -> None:
        """Take the distance of one point of the latest batch."""
        self._asked.tell(wanted, distance)


class _Search:
    """A search among points of one family.

    Args:
        tried: Vectors of constant fields that were tried, the best first, from which the first points are made; None
            if the family consists of constant fields, which are first changed alone.
    """

    def __init__(
        self,
        family: Sequence[Dimension],
        seeds: tuple[int, ...],
        portfolio: Sequence[SearchMethod],
        tried: Sequence[Floats] | None = None,
    ) -> None:
        self.encoding = Encoding(tuple(each.search for each in family))
        self.nearest = math.inf
        self._portfolio = portfolio
        self._seeds = seeds
        self._rng = np.random.default_rng([*seeds, 99])
        self._history = History()
        self._largest = 1.0
        self._usual = math.inf  # worth of the nominal point; of the first one until that is known
        self._known: dict[tuple[float, ...], float | None] = {}
        self._constant = tried is None
        self._mixed = Recombination(family, tried or _star(self.encoding), np.random.default_rng([*seeds, 98]))
        # Before the methods, points that vary in time are made from constant ones.
        self._probes = (self._mixed.ask() for _ in range(0 if self._constant else 24))
        self._lines = CoordinateSearch(self.encoding) if self._constant else None
        self._methods: list[Proposer] | None = None
        self._turn = 0

    @property
    def runs(self) -> int:
        """Number of points that were evaluated."""
        return len(self._known)

    def ranked(self) -> list[Floats]:
        """Return the vectors of all points, the best first."""
        return [self._history.vectors[at] for at in self._history.ranked()]

    def lines(self, size: int) -> list[_Proposal]:
        """Return up to `size` new points along single fields; none when these have been followed to their ends."""
        made: dict[tuple[float, ...], _Proposal] = {}
        while self._lines is not None and len(made) < size and (vector := self._lines.ask()) is not None:
            self._propose(vector, self._lines, made)
        return list(made.values())

    def batch(self, size: int) -> list[_Proposal]:
        """Return up to `size` new points; none when the space is exhausted."""
        made: dict[tuple[float, ...], _Proposal] = {}
        for probe in self._probes:
            self._propose(probe, None, made)
            if len(made) == size:
                break
        if made:
            return list(made.values())
        if found := self.lines(size):
            return found
        if self._methods is None:
            self._methods = proposers(self._portfolio, self._history, self.encoding.nominal, self._seeds)
        idle = 0
        while len(made) < size and idle < _REPEATS:
            owner = self._next(self._methods)
            vector = owner.ask()
            if vector is None or not self._propose(vector, owner, made):
                idle += 1
        for _ in range(_REPEATS * size):
            if len(made) == size:
                break
            self._propose(self._rng.random(self.encoding.size), None, made)
        return list(made.values())

    def tell(self, wanted: _Proposal, distance: float | None) -> None:
        """Take the distance of one point."""
        if distance is not None and not math.isfinite(distance):
            distance = None
        if distance is not None:
            distance = min(max(distance, -_FAR), _FAR)
            self._largest = max(self._largest, distance)
            self.nearest = min(self.nearest, distance)
        key, worth = self._key(wanted.point), self._worth(wanted.vector, distance)
        if not self._known or key == self._key(self.encoding.decode(self.encoding.nominal)):
            self._usual = worth
        self._known[key] = distance
        self._history.add(wanted.vector, worth)
        for owner, vector in wanted.askers:
            owner.tell(vector, self._worth(vector, distance))

    def knows(self, point: Mapping[str, float]) -> bool:
        """Return whether a point was evaluated."""
        return self._key(point) in self._known

    def learn(self, point: Mapping[str, float], distance: float | None) -> None:
        """Take the distance of a point that another search evaluated."""
        self.tell(_Proposal(point, self.encoding.encode(point)), distance)

    def _next(self, methods: Sequence[Proposer]) -> Proposer:
        """Return the next method; until constant fields have reduced the distance, every other turn combines them."""
        self._turn += 1
        if self._constant and self.nearest < 0.9 * self._usual:  # progress, not noise
            return methods[self._turn % len(methods)]
        return methods[self._turn // 2 % len(methods)] if self._turn % 2 else self._mixed

    def _worth(self, vector: Floats, distance: float | None) -> float:
        if distance is not None:
            return distance
        # Worse than anything seen, and on a slope back to the nominal point, so that plateaus have a way out.
        return self._largest * (2.0 + float(np.linalg.norm(vector - self.encoding.nominal)))

    def _propose(self, vector: Floats, owner: Proposer | None, made: dict[tuple[float, ...], _Proposal]) -> bool:
        """Add a vector to the batch, or tell its owner the result if it is known; return whether it was new."""
        point = self.encoding.decode(vector)
        key = self._key(point)
        if key in self._known:
            if owner is not None:
                owner.tell(vector, self._worth(vector, self._known[key]))
            return False
        new = key not in made
        wanted = made.setdefault(key, _Proposal(point, vector))
        if owner is not None:
            wanted.askers.append((owner, vector))
        return new

    def _key(self, point: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(point[field.name] for field in self.encoding.fields)


def _star(encoding: Encoding) -> list[Floats]:
    """Return vectors in which all numbers move by the same step."""
    return [np.clip(encoding.nominal + reach, 0.0, 1.0) for reach in _PROBES]
