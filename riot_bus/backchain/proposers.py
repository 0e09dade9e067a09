"""Search methods that share one history: each proposes the next vector in [0, 1]^n, and is told its value.

Third-party methods are found by the entry points `riot_bus.search`; `riot_bus.testing.search` tests them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, needs_extra

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from cmaes import CMA

    from riot_bus.backchain.fir import Floats

_CANDIDATES = 300  # a guess: 225 near the best points, 75 anywhere
_FIT_LIMIT = 600  # three times the default budget; bounds the fit in long or shared searches


class History:
    """Vectors evaluated so far, and how good they were (smaller is better, finite)."""

    def __init__(self) -> None:
        self.vectors: list[Floats] = []
        self.values: list[float] = []

    def add(self, vector: Floats, value: float) -> None:
        """Append one evaluation."""
        self.vectors.append(vector)
        self.values.append(value)

    def ranked(self) -> list[int]:
        """Return the numbers of the evaluations, best first, earlier first among equals."""
        return [int(at) for at in np.argsort(self.values, kind="stable")]


class Proposer(Protocol):
    """A search method at work."""

    def ask(self) -> Floats | None:
        """Return the next vector to try, shape (n,) in [0, 1]; None while the value of an earlier one is needed."""
        ...

    def tell(self, vector: Floats, value: float) -> None:
        """Take the value of a vector that this method proposed; smaller is better."""
        ...


SearchMethod = Callable[[History, "Floats", np.random.Generator], Proposer]
"""Factory of a search method, from the history, which grows by itself, the nominal vector, shape (n,), and an RNG.

A method with an attribute `least_size` is left out if there are fewer dimensions.
"""


class Simplex:
    """Nelder-Mead from the best points of the history; it restarts when the simplex has shrunk."""

    def __init__(self, history: History, nominal: Floats, rng: np.random.Generator) -> None:
        del nominal
        self._history = history
        self._rng = rng
        self._steps: Generator[Floats, float, None] | None = None
        self._pending = False
        self._next: Floats | None = None

    def ask(self) -> Floats | None:
        """Return the next vertex, or None while one is pending."""
        if self._pending or not self._history.vectors:
            return None
        if self._steps is None or self._next is None:
            self._steps = self._descend()
            self._next = next(self._steps)
        self._pending = True
        return self._next

    def tell(self, vector: Floats, value: float) -> None:
        """Take the value of the pending vertex."""
        self._pending = False
        if self._steps is not None:
            try:
                self._next = self._steps.send(value)
            except StopIteration:
                self._steps = None

    def _start(self) -> list[tuple[float, Floats]]:
        """Return the best points that lie in different directions, best first; fewer if they do not span the space."""
        vectors, values = self._history.vectors, self._history.values
        chosen: list[int] = []
        basis: list[Floats] = []
        for at in self._history.ranked():
            if chosen:
                edge = vectors[at] - vectors[chosen[0]]
                rest = edge - sum((float(edge @ one) * one for one in basis), np.zeros_like(edge))
                length = float(np.linalg.norm(rest))
                if length < max(0.3 * float(np.linalg.norm(edge)), 1e-3):
                    continue
                basis.append(rest / length)
            chosen.append(at)
            if len(chosen) == len(vectors[0]) + 1:
                break
        return [(values[at], vectors[at]) for at in chosen]

    def _descend(self) -> Generator[Floats, float, None]:
        corners = self._start()
        size = len(corners[0][1])
        while len(corners) < size + 1:
            step = np.zeros(size)
            step[len(corners) - 1] = 0.05 * self._rng.choice([-1.0, 1.0])
            vector = np.clip(corners[0][1] + step, 0.0, 1.0)
            corners.append(((yield vector), vector))
        for _ in range(20 * size):
            corners.sort(key=lambda corner: corner[0])
            worst, far = corners[-1]
            if max(float(np.abs(corner[1] - corners[0][1]).max()) for corner in corners) < 1e-3:
                return
            center = np.mean([corner[1] for corner in corners[:-1]], axis=0)
            vector = np.clip(2 * center - far, 0.0, 1.0)
            value = yield vector
            if value < corners[0][0]:
                longer = np.clip(3 * center - 2 * far, 0.0, 1.0)
                reach = yield longer
                corners[-1] = (reach, longer) if reach < value else (value, vector)
            elif value < corners[-2][0]:
                corners[-1] = (value, vector)
            else:
                inner = (center + (vector if value < worst else far)) / 2
                middle = yield inner
                if middle < min(value, worst):
                    corners[-1] = (middle, inner)
                else:
                    for at in range(1, len(corners)):
                        shrunk = (corners[0][1] + corners[at][1]) / 2
                        corners[at] = ((yield shrunk), shrunk)


class Forest:
    """Expected improvement of an extra-trees surrogate over mutations of the elite and random points."""

    def __init__(self, history: History, nominal: Floats, rng: np.random.Generator) -> None:
        del nominal
        self._history = history
        self._rng = rng

    def ask(self) -> Floats | None:
        """Return the candidate with the largest expected improvement; None with fewer than five points."""
        if len(self._history.values) < 5:
            return None
        with needs_extra("scikit-learn", "analysis"):
            from sklearn.ensemble import ExtraTreesRegressor
        kept = self._history.ranked()[:_FIT_LIMIT]
        vectors = np.asarray([self._history.vectors[at] for at in kept])
        values = np.log1p(np.maximum(np.asarray([self._history.values[at] for at in kept]), 0.0))
        seed = int(self._rng.integers(2**31))
        # a guess: the forest is fitted anew for each proposal; not measured
        model = ExtraTreesRegressor(n_estimators=40, min_samples_leaf=1, random_state=seed, n_jobs=1)
        model.fit(vectors, values)
        candidates = self._candidates(vectors)
        guesses = np.asarray([tree.tree_.predict(candidates.astype(np.float32))[:, 0] for tree in model.estimators_])
        gain = np.maximum(values.min() - guesses, 0.0).mean(axis=0)
        # Where no tree expects a gain, the trees' disagreement decides.
        score = gain + 1e-3 * guesses.std(axis=0) - 1e-6 * guesses.mean(axis=0)
        best: Floats = candidates[int(score.argmax())]
        return best

    def tell(self, vector: Floats, value: float) -> None:
        """Do nothing: everything is in the history."""

    def _candidates(self, vectors: Floats) -> Floats:
        rng, size = self._rng, vectors.shape[1]
        elite = vectors[: min(8, len(vectors))]
        count = 3 * _CANDIDATES // 4
        mutated = elite[rng.integers(len(elite), size=count)].copy()
        moved = rng.random((count, size)) < max(1.0 / size, 0.3)
        moved[np.arange(count), rng.integers(size, size=count)] = True
        steps = rng.normal(size=(count, size)) * 10.0 ** rng.uniform(-2.5, -0.5, size=(count, 1))
        mutated = np.where(moved, mutated + steps, mutated)
        fresh = rng.random((_CANDIDATES - count, size))
        return np.clip(np.vstack([mutated, fresh]), 0.0, 1.0)


class Evolution:
    """CMA-ES that restarts alternately from the nominal point and at random, with growing population."""

    least_size: ClassVar[int] = 2
    """CMA-ES adapts a covariance, which needs two dimensions."""

    def __init__(self, history: History, nominal: Floats, rng: np.random.Generator) -> None:
        del history
        self._nominal = nominal
        self._rng = rng
        self._restarts = 0
        self._answers: list[tuple[Floats, float]] = []
        self._asked = 0
        self._idle = 0
        self._best = float("inf")
        self._engine = self._begin()

    def ask(self) -> Floats | None:
        """Return one more member of the generation, or None when all of it is pending."""
        if self._asked >= self._engine.population_size:
            return None
        self._asked += 1
        vector: Floats = np.clip(self._engine.ask(), 0.0, 1.0)
        return vector

    def tell(self, vector: Floats, value: float) -> None:
        """Take one value; a complete generation moves the distribution."""
        self._answers.append((vector, value))
        if len(self._answers) < self._engine.population_size:
            return
        best = min(answer[1] for answer in self._answers)
        self._idle = 0 if best < self._best else self._idle + 1
        self._best = min(best, self._best)
        self._engine.tell(self._answers)
        self._answers, self._asked = [], 0
        if self._idle >= 12 or self._engine.should_stop():
            self._restarts += 1
            self._idle, self._best = 0, float("inf")
            self._engine = self._begin()

    def _begin(self) -> CMA:
        with needs_extra("cmaes", "analysis"):
            from cmaes import CMA
        size = len(self._nominal)
        mean = self._rng.random(size) if self._restarts % 2 else self._nominal
        return CMA(
            mean=np.clip(mean, 0.05, 0.95),
            sigma=0.2,
            bounds=np.tile([0.0, 1.0], (size, 1)),
            seed=int(self._rng.integers(2**31)),
            population_size=min(4 + int(3 * np.log(size)) + 2 * self._restarts, 40),
        )


PORTFOLIO: tuple[SearchMethod, ...] = (Simplex, Forest, Evolution)
"""The methods that take turns by default."""


def proposers(
    methods: Sequence[SearchMethod], history: History, nominal: Floats, seeds: Sequence[int]
) -> list[Proposer]:
    """Return the search methods of a portfolio, each with its own random numbers.

    Raises:
        ConfigError: All of them need more dimensions.
    """
    size = len(nominal)
    found = [
        method(history, nominal, np.random.default_rng([*seeds, number]))
        for number, method in enumerate(methods)
        if size >= getattr(method, "least_size", 1)
    ]
    if not found:
        text = f"no search method is left for {counted(size, 'field')}"
        raise ConfigError(text, where="--search", hint="name one that needs fewer, such as simplex")
    return found
