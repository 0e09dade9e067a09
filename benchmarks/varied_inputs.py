"""Runs until inputs that have to vary in time, or are no plain numbers, make a system fail.

Usage: python benchmarks/varied_inputs.py [--seeds N] [--budget RUNS] [--json FILE] [SCENARIO...]

The systems are functions of what their inputs are over time; distances are those of rules, as in `riot activate`. For
comparison, uniform values on the same scales, half of them constant, half of them varied likewise.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.varied import VariedInputs
from riot_bus.chain.whole.driven_system import least_distance
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.trial import Series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Inputs = Mapping[str, NDArray[np.float64]]
    Evaluate = Callable[[Sequence[Mapping[str, float]]], list[Evaluation]]

COUNT, SECONDS = 60, 3.0
TIMES = np.arange(COUNT) * SECONDS / COUNT
GOAL = SearchField("goal", 3.0, 1.0, -5000, 5000)
IDLE = SearchField("idle", 0.0, 1.0, -5000, 5000)
MODES = "abcdefg"


@dataclass(frozen=True)
class Scenario:
    """A system: what may be set, what comes of it inside, and the rule of the failure."""

    fields: tuple[SearchField, ...]
    inside: Callable[[Inputs], dict[str, Sequence[Any]]]
    rule: Rule
    topics: tuple[str, ...] = ()


def raw(name: str, operator: str, value: Any) -> Literal:
    return Literal(Feature("raw", (name,)), operator, value)


def true(name: str) -> Literal:
    return Literal(Feature("raw", (name,)), "==", value=True)


def armed(inputs: Inputs, high: float, low: float) -> dict[str, Sequence[Any]]:
    """A unit that is armed when a lever has been up and down again."""
    up, on, states = False, False, []
    for value in inputs["arm"].tolist():
        up = up or value > high
        on = on or (up and value < low)
        states.append(on)
    return {"u:armed": states, "u:goal": inputs["goal"].tolist()}


def resonant(inputs: Inputs) -> dict[str, Sequence[Any]]:
    """A spring with a period of 0.6 s and little damping, pulled with 20 at most."""
    rate, damping, place, speed, step = 2 * math.pi / 0.6, 0.05, 0.0, 0.0, SECONDS / COUNT / 5
    places = []
    for value in np.clip(inputs["x"], -20, 20).tolist():
        for _ in range(5):
            speed += (rate * rate * (value - place) - 2 * damping * rate * speed) * step
            place += speed * step
        places.append(place)
    return {"u:y": places}


ARMED = Rule(((true("u:armed"), raw("u:goal", "<", -80)),))
X = SearchField("x", 3.0, 1.0, -5000, 5000)
WHOLE = {"integer": True}
FLAG = SearchField("arm", 0, 0.5, 0, 1, **WHOLE)
SCENARIOS = {
    "pulse, then goal": Scenario((SearchField("arm", 0, 0.1, -250, 250), GOAL), lambda x: armed(x, 5, 1), ARMED),
    "flag up and down": Scenario(
        (SearchField("arm", 0, 0.5, 0, 1, **WHOLE), GOAL), lambda x: armed(x, 0.9, 0.1), ARMED
    ),
    "jump": Scenario(
        (X, IDLE),
        lambda x: {"u:x": x["x"].tolist()},
        Rule(((raw("u[1]:x", ">", 400), raw("u[0]:x", "<", 10)),)),
        ("u", "u"),
    ),
    "resonance": Scenario((X, IDLE), resonant, Rule(((raw("u:y", ">", 100),),))),
    "enum with a range": Scenario(
        (SearchField("mode", 0, 0.5, 0, 6, **WHOLE), GOAL, IDLE),
        lambda x: {"u:mode": [int(one) for one in x["mode"]], "u:goal": x["goal"].tolist()},
        Rule(((raw("u:mode", "==", 3), raw("u:goal", ">", 200), raw("u:goal", "<", 260)),)),
    ),
    "text with a range": Scenario(
        (SearchField("mode", 0, 0.5, 0, 6, **WHOLE, choice=True), GOAL, IDLE),
        lambda x: {"u:mode": [MODES[int(one)] for one in x["mode"]], "u:goal": x["goal"].tolist()},
        Rule(((raw("u:mode", "==", "d"), raw("u:goal", ">", 200), raw("u:goal", "<", 260)),)),
    ),
    "boolean": Scenario(
        (SearchField("flag", 0, 0.5, 0, 1, **WHOLE), GOAL, IDLE),
        lambda x: {"u:flag": [one > 0.5 for one in x["flag"].tolist()], "u:goal": x["goal"].tolist()},
        Rule(((true("u:flag"), raw("u:goal", ">", 1000)),)),
    ),
    "sum wraps": Scenario(
        (SearchField("y", 1e6, 1e4, 0, 2**32 - 1, **WHOLE), SearchField("h", 2000, 50, 1000, 65535, **WHOLE)),
        lambda x: {"u:y": [int(one) for one in x["y"]], "u:h": [int(one) for one in x["h"]]},
        Rule(((Literal(Feature("wrap32", ("u:y", "u:h")), "<", 1000),),)),
    ),
}


def system(
    scenario: Scenario, varied: VariedInputs, seed: int
) -> Callable[[Sequence[Mapping[str, float]]], list[Evaluation]]:
    rng = np.random.default_rng([seed, 5])

    def inputs(point: Mapping[str, float]) -> Inputs:
        found = {
            field.name: np.full(COUNT, field.nominal)
            + (0 if field.integer else 0.3 * field.spread * rng.normal(size=COUNT))
            for field in scenario.fields
        }
        for drive in varied.drives(point):
            values = found[drive.field]
            if drive.value is None:
                values[:] = np.interp(TIMES, *zip(*drive.points, strict=True))
            elif drive.message is not None:
                values[drive.message] = drive.value
            else:
                end = math.inf if drive.end is None else drive.end
                values[(drive.start <= TIMES) & (end > TIMES)] = drive.value
        return found

    def evaluate(points: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        answers = []
        for point in points:
            inside = scenario.inside(inputs(point))
            seen = {name: Series(tuple(TIMES.tolist()), tuple(values)) for name, values in inside.items()}
            near = least_distance(scenario.rule, seen, {}, scenario.topics)
            answers.append(Evaluation(near, near is not None and near <= 0))
        return answers

    return evaluate


def riot(scenario: Scenario, seed: int, budget: int) -> int | None:
    varied = VariedInputs(scenario.fields, SECONDS, [COUNT] * len(scenario.fields))
    evaluate = system(scenario, varied, seed)
    found = activate(scenario.fields, evaluate, seed=seed, budget=budget, families=varied.families)
    return found.runs if found.found is not None else None


def uniform(scenario: Scenario, seed: int, budget: int) -> int | None:
    varied = VariedInputs(scenario.fields, SECONDS, [COUNT] * len(scenario.fields))
    evaluate, rng = system(scenario, varied, seed), np.random.default_rng(seed)
    spaces = [Encoding(scenario.fields)] * len(varied.families)
    spaces += [Encoding(tuple(each.search for each in family)) for family in varied.families]
    for run in range(1, budget + 1):
        space = spaces[run % len(spaces)]
        if evaluate([space.decode(rng.random(space.size))])[0].failed:
            return run
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--budget", type=int, default=300)
    parser.add_argument("--json", type=Path)
    parser.add_argument("scenarios", nargs="*", help="all by default")
    options = parser.parse_args()
    rows = []
    for name in options.scenarios or SCENARIOS:
        for method in (riot, uniform):
            runs = [method(SCENARIOS[name], seed, options.budget) for seed in range(options.seeds)]
            solved = sum(one is not None for one in runs) / len(runs)
            ordered = sorted(math.inf if one is None else one for one in runs)
            row = {"scenario": name, "method": method.__name__, "solved": solved}
            rows.append(row | {"median": ordered[len(runs) // 2], "p90": ordered[math.ceil(0.9 * len(runs)) - 1]})
            print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
