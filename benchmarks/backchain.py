"""Figures of permeability, activation and the region map on synthetic systems.

Usage: python benchmarks/backchain.py [--seeds N] [--only PART] [--scenarios NAME ...] [--mirror] [--json FILE]

The systems are rebuilt from the descriptions in the literature of the project; their noise and effect sizes are ours.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import ks_2samp
from search_peers import BUDGETS, PEERS, Plain, runs_to_failure

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.permeability import FieldDrive, Run, analyse
from riot_bus.backchain.region import map_region
from riot_bus.backchain.varied import VariedInputs
from riot_bus.vocabulary.injection import Signal
from riot_bus.vocabulary.trial import Series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Evaluate = Callable[[Sequence[Mapping[str, float]]], Sequence[Evaluation]]

REAL = {"ext00": "linear", "ext01": "weak", "ext02": "variance", "ext03": "even"}
LAGS = (2, 3, 1, 4)
BUDGET = 1000
SCENARIOS: dict[str, dict[str, Any]] = {
    "base": {},
    "12": {"irrelevant": 8},
    "thin": {"depth": 3.0},
    "noisy": {"noise": 5.0, "depth": 5.0},
    "corner": {"corner": True},
    "deceptive": {"hump": True},
    "gate": {"gate": True},
}


def internal(inputs: Sequence[NDArray[np.float64]], rng: np.random.Generator, *, weak: float) -> NDArray[np.float64]:
    """Return an internal series with noise of autocorrelation 0.7, and a level of its own per run."""
    samples = len(inputs[0])
    noise = np.empty(samples)
    noise[0] = rng.normal()
    for at in range(1, samples):
        noise[at] = 0.7 * noise[at - 1] + np.sqrt(1 - 0.49) * rng.normal()
    late = [np.concatenate([np.full(lag, one[0]), one])[:samples] for lag, one in zip(LAGS, inputs, strict=False)]
    level = 0.8 * late[0] + weak * late[1] + 0.7 * (2 * np.abs(late[3]) - 1)
    return level + 0.6 * noise * np.exp(1.2 * late[2]) + 3 * rng.normal()


def multiplexed(runs: int, *, externals: int, seed: int, weak: float) -> list[Run]:
    """Return runs in which every external field is driven at once."""
    rng = np.random.default_rng(seed)
    times = tuple(0.1 * at for at in range(60))
    made = []
    for number in range(runs):
        signals = [Signal(0.0, 1.0, 5, seed=1_000_003 * seed + 1009 * number + at) for at in range(externals)]
        sent = [[signal.value(index) for index in range(len(times))] for signal in signals]
        output = internal([np.asarray(one) for one in sent], rng, weak=weak)
        drives = {
            f"ext{at:02d}": FieldDrive(Series(times, tuple(one)), signal)
            for at, (one, signal) in enumerate(zip(sent, signals, strict=True))
        }
        made.append(Run(drives, {"unit:y": Series(times, tuple(output.tolist()))}))
    return made


def one_at_a_time(*, externals: int, seed: int, weak: float, level: float = 0.05) -> set[str]:
    """Return the fields that Kolmogorov-Smirnov on pooled samples finds (11 values each, beside 8 fixed runs)."""
    rng = np.random.default_rng(seed)
    fixed = [np.zeros(60)] * externals
    base = np.concatenate([internal(fixed, rng, weak=weak) for _ in range(8)])
    found = set()
    for at in range(externals):
        pooled = []
        for value in rng.uniform(-1, 1, size=11):
            inputs = list(fixed)
            inputs[at] = np.full(60, value)
            pooled.append(internal(inputs, rng, weak=weak))
        if ks_2samp(base, np.concatenate(pooled)).pvalue < level / externals:
            found.add(f"ext{at:02d}")
    return found


def permeability(seeds: int) -> list[dict[str, Any]]:
    rows = []
    for externals, runs, weak in (
        (12, 4, 0.5),
        (12, 8, 0.5),
        (12, 16, 0.5),
        (50, 8, 0.5),
        (50, 16, 0.5),
        (12, 8, 0.35),
    ):
        begin = time.perf_counter()
        found = []
        for seed in range(seeds):
            data = multiplexed(runs, externals=externals, seed=seed, weak=weak)
            found.append({edge.external for edge in analyse(data, seed=seed).permeable()})
        rows.append(score(f"multiplexed, {externals} externals, {runs} runs, weak {weak}", found))
        rows[-1]["seconds"] = (time.perf_counter() - begin) / seeds
    pooled = [one_at_a_time(externals=12, seed=seed, weak=0.5) for seed in range(seeds)]
    rows.append(score("one at a time, KS on pooled samples, 140 runs", pooled))
    return rows


def score(name: str, found: Sequence[set[str]]) -> dict[str, Any]:
    false = [len(one - set(REAL)) / max(len(one), 1) for one in found]
    row: dict[str, Any] = {"method": name, "power": float(np.mean([len(one & set(REAL)) / 4 for one in found]))}
    row |= {"fdr": float(np.mean(false)), "any false": float(np.mean([one > 0 for one in false]))}
    return row | {kind: float(np.mean([name in one for one in found])) for name, kind in REAL.items()}


def rover(
    *,
    irrelevant: int = 0,
    depth: float = 20.0,
    noise: float = 0.0,
    corner: bool = False,
    hump: bool = False,
    gate: bool = False,
    seed: int,
) -> tuple[list[SearchField], Evaluate]:
    """Return the fields and the system of the paper's example: goals off the map are refused."""
    rng = np.random.default_rng([seed, 7])
    fields = [SearchField("goal.x", 2.0, 1.0, -5000, 5000), SearchField("goal.y", 3.0, 1.0, -5000, 5000)]
    fields += [SearchField("vx", 0.5, 0.2, -5000, 5000), SearchField("vy", 0.0, 0.2, -5000, 5000)]
    fields += [SearchField(f"other{at}", 0.0, 1.0, -5000, 5000) for at in range(irrelevant)]

    def evaluate(points: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        answers = []
        for point in points:
            x, y = point["goal.x"], point["goal.y"]
            if abs(x) >= 100 or abs(y) >= 100:
                answers.append(Evaluation(None, failed=False))
                continue
            away = y + 100 - depth - float(np.clip(point["vy"], -2, 2)) + noise * float(rng.normal())
            if corner:
                away = max(away, 80 - x)
            if gate and not 1 < point["vx"] < 3:  # nothing moves
                away = 83.0
            shown = 80 - away if hump and 10 < away < 40 else away
            answers.append(Evaluation(max(shown, 0.0), away < 0))
        return answers

    return fields, evaluate


def mirrored(fields: Sequence[SearchField], evaluate: Evaluate, seed: int) -> tuple[list[SearchField], Evaluate]:
    """Return the system with signs and order of its fields drawn, and nominal values moved by up to three spreads."""
    rng = np.random.default_rng([seed, 11])
    signs = {each.name: float(rng.choice([-1, 1])) for each in fields}
    moved = [
        replace(each, nominal=signs[each.name] * (each.nominal + rng.uniform(-3, 3) * each.spread)) for each in fields
    ]

    def seen(points: Sequence[Mapping[str, float]]) -> Sequence[Evaluation]:
        return evaluate([{name: signs[name] * value for name, value in point.items()} for point in points])

    return [moved[at] for at in rng.permutation(len(moved))], seen


def portfolio(fields: Sequence[SearchField], evaluate: Evaluate, seed: int) -> int | None:
    """Search as `riot activate` does."""
    families = VariedInputs(fields, 3.0, [60] * len(fields)).families
    varied = {each.search.name for family in families for each in family}

    def constant(points: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        """Answer points that vary in time as if nothing came of them: these systems look at constants only."""
        return [Evaluation(None, failed=False) if point.keys() & varied else evaluate([point])[0] for point in points]

    result = activate(fields, constant, seed=seed, budget=BUDGET, families=families)
    return result.runs if result.found is not None else None


def activation(seeds: int, scenarios: Sequence[str], *, mirror: bool) -> list[dict[str, Any]]:
    """Count the runs to the first failure, of `riot activate` and of its peers on the plain scale and on riot's."""

    def system(seed: int, options: Mapping[str, Any]) -> tuple[list[SearchField], Evaluate]:
        found = rover(seed=seed, **options)
        return mirrored(*found, seed) if mirror else found

    def peer(
        name: str, space: type[Encoding], fields: Sequence[SearchField], evaluate: Evaluate, seed: int
    ) -> int | None:
        budget = BUDGETS.get(name, BUDGET)
        return runs_to_failure(PEERS[name], space(tuple(fields)), evaluate, seed=seed, budget=budget)

    methods: dict[str, Callable[..., int | None]] = {"riot": portfolio}
    for name in PEERS:
        if name == "TPE" and find_spec("optuna") is None:
            print("TPE is left out: optuna is not installed (extra study)")
            continue
        for scale, space in {"plain": Plain, "asinh": Encoding}.items():
            if (name, scale) != ("dictionary", "asinh"):  # its values are no places on a scale
                methods[f"{name}, {scale}"] = partial(peer, name, space)
    rows = []
    for method, search in methods.items():
        row: dict[str, Any] = {"method": method, "budget": BUDGETS.get(method.split(",")[0], BUDGET)}
        begin = time.perf_counter()
        for scenario in scenarios:
            options = SCENARIOS[scenario]
            row[scenario] = [search(*system(seed, options), seed) for seed in range(seeds)]
        rows.append(row | {"seconds": time.perf_counter() - begin})
        print(f"{method}: {rows[-1]['seconds']:.0f} s", flush=True)
    return rows


def in_short(runs: Sequence[int | None]) -> str:
    """Return median/90th percentile, - where it is beyond the budget, and the share solved unless it is all."""
    ordered = sorted(math.inf if one is None else one for one in runs)
    text = "/".join(f"{ordered[math.ceil(share * len(runs)) - 1]:g}" for share in (0.5, 0.9)).replace("inf", "-")
    solved = sum(one is not None for one in runs) / len(runs)
    return text if solved == 1 else f"{text} ({solved:.3g})"


def region(seeds: int) -> list[dict[str, Any]]:
    axes = (SearchField("goal.x", 2.0, 1.0, -5000, 5000), SearchField("goal.y", 3.0, 1.0, -5000, 5000))
    rows = []
    for noise in (0.0, 2.0):
        errors, asked = [], []
        for seed in range(seeds):
            rng = np.random.default_rng(seed)

            def ask(points: Sequence[Mapping[str, float]], rng: np.random.Generator = rng) -> list[bool]:
                edges = [-80 + noise * rng.uniform(-1, 1) for _ in points]  # noqa: B023
                goals = [(one["goal.x"], one["goal.y"]) for one in points]
                return [abs(x) < 100 and -100 < y < edge for (x, y), edge in zip(goals, edges, strict=True)]

            start = {"goal.x": rng.uniform(-99, 99), "goal.y": rng.uniform(-99, -83)}
            found = map_region(start, axes, ask, seed=seed, tolerance=5.0)
            sides = zip(found.box.edges, (-100, 100, -100, -80), strict=True)
            errors.append(max(abs(side - true) for side, true in sides))
            asked.append(len(found.samples) - 1)
        row = {"noise": noise, "runs median": float(np.median(asked)), "runs most": float(max(asked))}
        rows.append(row | {"error median": float(np.median(errors)), "error most": float(max(errors))})
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [names, *([show(row.get(name, "")) for name in names] for row in rows)]
    widths = [max(len(row[at]) for row in cells) for at in range(len(names))]
    for row in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    print()


def show(value: object) -> str:
    if isinstance(value, list):
        return in_short(value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--only", choices=["permeability", "activation", "region"])
    parser.add_argument(
        "--scenarios", nargs="+", choices=list(SCENARIOS), default=list(SCENARIOS), help="activation: only these"
    )
    parser.add_argument(
        "--mirror", action="store_true", help="activation: each seed has a system of its own (see mirrored)"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    parts: dict[str, Callable[[int], list[dict[str, Any]]]] = {
        "permeability": permeability,
        "activation": partial(activation, scenarios=options.scenarios, mirror=options.mirror),
        "region": region,
    }
    figures = {}
    for name in [options.only] if options.only else parts:
        figures[name] = parts[name](options.seeds)
        print(f"{name}, {options.seeds} seeds")
        table(figures[name])
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
