"""Other searches for a failure, as peers in backchain.py: each minimises the distance, and ends with the first failure.

Each works on the fields' own scale and, but for `dictionary`, on the encoding of `riot activate` as well. All but
`uniform` know the nominal point. Where the internal fields were never seen, the distance is a constant.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import Bounds, differential_evolution

from riot_bus.backchain.encoding import Encoding
from riot_bus.inject.dictionary import load_dictionary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.backchain.activation import Evaluation
    from riot_bus.backchain.fir import Floats

    Evaluate = Callable[[Sequence[Mapping[str, float]]], Sequence[Evaluation]]

UNSEEN = 1e6  # distance of runs in which the internal fields were never seen
Value = Callable[["Floats"], float]
Peer = Callable[[Value, Encoding, np.random.Generator], None]


class Plain(Encoding):
    """Points as vectors: each field's own scale, stretched to [0, 1]."""

    def encode(self, point: Mapping[str, float]) -> Floats:
        """Return the vector of a point."""
        return np.asarray([(point[each.name] - each.low) / (each.high - each.low) for each in self.fields])

    def decode(self, vector: Floats | Sequence[float]) -> dict[str, float]:
        """Return the point of a vector."""
        pairs = zip(self.fields, vector, strict=True)
        return {each.name: each.low + float(share) * (each.high - each.low) for each, share in pairs}


class _EndError(Exception):
    """A failure, or the end of the budget."""


def runs_to_failure(peer: Peer, space: Encoding, evaluate: Evaluate, *, seed: int, budget: int) -> int | None:
    """Return the number of the first run that failed, None if none did."""
    runs: list[bool] = []

    def value(vector: Floats) -> float:
        if len(runs) < budget:
            evaluation = evaluate([space.decode(vector)])[0]
            runs.append(evaluation.failed)
            if not evaluation.failed:
                return UNSEEN if evaluation.distance is None else evaluation.distance
        raise _EndError

    try:
        while True:  # a search that has converged begins anew
            peer(value, space, np.random.default_rng([seed, len(runs)]))
    except _EndError:
        return len(runs) if runs[-1] else None


def uniform(value: Value, space: Encoding, rng: np.random.Generator) -> None:
    """Independent random points."""
    while True:
        value(rng.random(space.size))


def dictionary(value: Value, space: Encoding, rng: np.random.Generator) -> None:
    """Values that the shipped dictionary has for the fields, if in their ranges; half of the fields stay nominal."""
    suggested = load_dictionary()
    usable = []
    for field in space.fields:
        values = [each.value for each in suggested.values_for("float64", field.name)]
        usable.append([one for one in values if isinstance(one, int | float) and field.low <= one <= field.high])
    while True:
        drawn = {each.name: rng.choice(some) for each, some in zip(space.fields, usable, strict=True)}
        value(np.where(rng.random(space.size) < 0.5, space.encode(drawn), space.nominal))


def tpe(value: Value, space: Encoding, rng: np.random.Generator) -> None:
    """Tree-structured Parzen estimator (optuna), the nominal point first."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=int(rng.integers(2**31))))
    ranges = {str(at): optuna.distributions.FloatDistribution(0, 1) for at in range(space.size)}
    study.enqueue_trial(dict(zip(ranges, space.nominal.tolist(), strict=True)))
    while True:
        trial = study.ask(ranges)
        study.tell(trial, value(np.asarray([trial.params[one] for one in ranges])))


def cma_es(value: Value, space: Encoding, rng: np.random.Generator) -> None:
    """CMA-ES (cmaes) from the nominal point, anew from a random one every 25 generations."""
    from cmaes import CMA

    start, box = space.nominal, np.tile([0.0, 1.0], (space.size, 1))
    while True:
        engine = CMA(mean=start, sigma=0.2, bounds=box, seed=int(rng.integers(2**31)))
        for _ in range(25):
            asked = [engine.ask() for _ in range(engine.population_size)]
            engine.tell([(vector, value(vector)) for vector in asked])
            if engine.should_stop():
                break
        start = rng.random(space.size)


def evolution(value: Value, space: Encoding, rng: np.random.Generator) -> None:
    """Differential evolution (scipy) with its usual settings, the nominal point among the first."""
    box = Bounds(np.zeros(space.size), np.ones(space.size))
    differential_evolution(value, box, x0=space.nominal, rng=rng, maxiter=10**6, polish=False)


PEERS: dict[str, Peer] = {"uniform": uniform, "dictionary": dictionary, "TPE": tpe, "CMA-ES": cma_es, "DE": evolution}
BUDGETS = {"TPE": 400}  # more would take too long
