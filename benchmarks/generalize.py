"""Trials that generalisation takes on synthetic systems: minimise, relevance, rules.

Run `python benchmarks/generalize.py [--seeds N] [--json FILE]`. The cost is the number of trials, beside a baseline
written here: ddmin, one field at a time, a decision tree on dictionary samples, product sets (`--only peers`: the last
two alone).
"""

from __future__ import annotations

import argparse
import json
import math
import random
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import show
from product_sets import product_sets
from rule_shapes import SHAPES, Shape, canonical, held_out, near_limits, variables_of

from riot_bus.generalize import rules
from riot_bus.generalize.features import features_of
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.oracle import assignment_key
from riot_bus.generalize.relevance import FieldSpace, relevant_fields
from riot_bus.generalize.rules import Variable, learn_rule
from riot_bus.generalize.sampling import columns_of, interesting, scalars_of
from riot_bus.generalize.table import Table
from riot_bus.generalize.validation import near_limits as near_limit_cases
from riot_bus.vocabulary.trial import Scalar

Row = dict[str, Any]


def spread(values: Sequence[float]) -> str:
    """Median/90th percentile."""
    return f"{statistics.median(values):.0f}/{np.percentile(values, 90):.0f}"


# -- minimise ---------------------------------------------------------------------------------------------------------


def ddmin(n: int, fails: Callable[[tuple[int, ...]], bool]) -> int:
    """Return the trials of plain delta debugging (Zeller), with a cache."""
    asked: dict[tuple[int, ...], bool] = {}

    def check(items: list[int]) -> bool:
        key = tuple(items)
        if key not in asked:
            asked[key] = fails(key)
        return asked[key]

    items, parts = list(range(n)), 2
    while len(items) >= 2:
        edges = [len(items) * part // parts for part in range(parts + 1)]
        chunks = [items[a:b] for a, b in pairwise(edges)]
        chunk = next((chunk for chunk in chunks if check(chunk)), None)
        if chunk is not None:
            items, parts = chunk, 2
            continue
        rests = ([item for other in chunks if other is not chunk for item in other] for chunk in chunks)
        rest = next((rest for rest in rests if parts > 2 and check(rest)), None)
        if rest is not None:
            items, parts = rest, max(parts - 1, 2)
        elif parts >= len(items):
            break
        else:
            parts = min(len(items), 2 * parts)
    return len(asked)


def answerer(wanted: set[int], batches: list[int] | None = None) -> Callable[[Sequence[tuple[int, ...]]], list[bool]]:
    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        if batches is not None:
            batches.append(len(questions))
        return [wanted <= set(question) for question in questions]

    return ask


def minimize_table(seeds: int) -> list[Row]:
    rows = []
    for n, needed in ((1000, 1), (1000, 3), (5000, 1), (5000, 3)):
        plain, weighted, wide, base = [], [], [], []
        for seed in range(seeds):
            chance = random.Random(seed * 7919 + n + needed)
            # Ten topics; a tenth of the log is injected, and what is needed is injected in nine logs of ten.
            topics = [f"t{chance.randrange(10)}" for _ in range(n)]
            injected = [topic == "t0" for topic in topics]
            likely = [index for index in range(n) if injected[index]]
            uniform = set(chance.sample(range(n), needed))
            biased = set(chance.sample(likely if chance.random() < 0.9 else range(n), needed))
            weights = [20.0 if hit else 1.0 for hit in injected]
            result = minimize(n, answerer(uniform))
            assert set(result.kept) == uniform
            plain.append(result.trials - 2)
            biased_ask = answerer(biased)
            prior = minimize(n, biased_ask, weights=weights, groups=topics)
            assert set(prior.kept) == biased
            weighted.append(prior.trials - 2)
            batches: list[int] = []
            minimize(n, answerer(uniform, batches), parallelism=8)
            wide.append(len(batches))
            base.append(ddmin(n, uniform.issubset))
        rows.append(
            {
                "log/needed": f"{n}/{needed}",
                "no prior": spread(plain),
                "prior": spread(weighted),
                "batches of 8": spread(wide),
                "ddmin": spread(base),
            }
        )
    return rows


# -- relevance --------------------------------------------------------------------------------------------------------


def field_answerer(wanted: list[str], *, parity: bool) -> Callable[[Sequence[Mapping[str, Scalar]]], list[bool]]:
    def fails(question: Mapping[str, Scalar]) -> bool:
        values = [int(question[name]) for name in wanted]
        if parity:
            return values[0] * values[1] < 0
        return values[0] < 0 and all(value == 3 for value in values[1:])

    return lambda questions: [fails(question) for question in questions]


def one_at_a_time(fields: list[FieldSpace], wanted: list[str], *, parity: bool) -> tuple[int, set[str]]:
    """Draw up to 4 replacements for each field alone; it is relevant when one of them heals."""
    ask = field_answerer(wanted, parity=parity)
    failing = {name: next(field.failing for field in fields if field.name == name) for name in wanted}
    trials, found = 0, set()
    for number, field in enumerate(fields):
        for value in random.Random(number).sample(list(field.draws), 4):
            trials += 1
            if not ask([{**failing, field.name: value}])[0]:
                found.add(field.name)
                break
    return trials, found


def relevance_table(seeds: int, straight: int = 12) -> list[Row]:
    rows = []
    for n, relevant, parity in ((50, 2, False), (500, 3, False), (5000, 3, False), (50, 2, True), (5000, 2, True)):
        trials, search, right, single, alone = [], [], 0, [], 0
        for seed in range(seeds if n < 5000 else max(3, seeds // 4)):
            chance = random.Random(seed * 31 + n)
            names = [f"f{index}" for index in range(n)]
            wanted = chance.sample(names, relevant)
            # One exceptional value, the others mode fields whose nominal value is needed; or x * y < 0.
            draws = tuple(range(-5, 0)) + tuple(range(1, 6))
            fields = []
            for name in names:
                injected = name == wanted[0] or chance.random() < 0.02
                failing = -1 if name == wanted[0] else 3
                fields.append(FieldSpace(name, failing, 4 if injected else None, draws))
            found = relevant_fields(fields, field_answerer(wanted, parity=parity), seed=seed, straight=straight)
            right += {field.name for field in found.fields} == set(wanted)
            trials.append(found.trials)
            search.append(found.trials - 2 * straight)
            cost, named = one_at_a_time(fields, wanted, parity=parity)
            single.append(cost)
            alone += named == set(wanted)
        rows.append(
            {
                "fields/relevant": f"{n}/{relevant}" + (" parity" if parity else ""),
                "search": spread(search),
                "with both stopping rules": spread(trials),
                "right": f"{right / len(trials):.0%}",
                "one at a time, 4 draws": spread(single),
                "it is right": f"{alone / len(trials):.0%}",
            }
        )
    return rows


# -- rules ------------------------------------------------------------------------------------------------------------


def balanced(predicted: Any, truth: Any) -> float:
    rates = [float((predicted == truth)[truth == side].mean()) for side in (True, False) if (truth == side).any()]
    return sum(rates) / len(rates)


def known_values(variables: list[Variable]) -> dict[str, Sequence[Any]]:
    """Dictionary and nominal values of each variable."""
    return {v.name: [v.failing, *v.nominal] if "[" in v.type else interesting(v) for v in variables}


def tree_accuracy(shape: Shape, variables: list[Variable], seed: int, budget: int, held: Any, truth: Any) -> float:
    """Decision tree on derived features of samples from dictionary and nominal values."""
    from sklearn.tree import DecisionTreeClassifier

    chance = random.Random(seed)
    known = known_values(variables)
    samples = [{name: chance.choice(values) for name, values in known.items()} for _ in range(budget)]
    features = features_of({v.name: v.type for v in scalars_of(variables)})
    values = sorted({str(s[v.name]) for v in variables if v.type == "string" for s in samples})

    def matrix(rows: Any) -> Any:
        columns = columns_of(variables, rows)
        found = [feature.values(columns) for feature in features]
        numbers = [np.clip(np.nan_to_num(f.astype(float)), -1e30, 1e30) for f in found if f is not None]
        names = [v.name for v in variables if v.type == "string"]
        hot = [np.array([row[name] == value for row in rows], dtype=float) for name in names for value in values]
        return np.column_stack(numbers + hot)

    labels = np.array([shape.fails(sample) for sample in samples])
    if labels.all() or not labels.any():
        return 0.5
    tree = DecisionTreeClassifier(random_state=seed).fit(matrix(samples), labels)
    return balanced(tree.predict(matrix(held)), truth)


def product_accuracy(shape: Shape, variables: list[Variable], seed: int, budget: int, held: Any, truth: Any) -> float:
    """Product sets, from the failing values on."""
    failing = {variable.name: variable.failing for variable in variables}
    said = product_sets(failing, known_values(variables), lambda case: bool(shape.fails(case)), budget, seed)
    return balanced(np.array([said(case) for case in held]), truth)


@dataclass(frozen=True)
class _Run:
    """What came of one rule that was learnt."""

    text: str
    trials: int
    accuracy: float
    near: float
    exact: bool
    written: bool
    claimed: float | None
    peers: dict[str, float]


PEERS = {"tree": tree_accuracy, "products": product_accuracy}


def _held_out(shape: Shape, variables: list[Variable], chance: random.Random) -> tuple[list[Any], Any]:
    held = [held_out(shape, variables, chance) for _ in range(1000)]
    return held, np.array([shape.fails(sample) for sample in held])


def _peers(work: tuple[int, int, int]) -> dict[str, float]:
    number, seed, budget = work
    shape = SHAPES[number]
    variables = variables_of(shape, seed)
    held, truth = _held_out(shape, variables, random.Random(seed + 10_000))
    return {name: accuracy(shape, variables, seed, budget, held, truth) for name, accuracy in PEERS.items()}


def _learn(work: tuple[int, int, int, bool]) -> _Run:
    number, seed, budget, peers = work
    shape = SHAPES[number]
    variables = variables_of(shape, seed)
    chance = random.Random(seed + 10_000)
    held, _ = _held_out(shape, variables, chance)
    learned = learn_rule(
        variables,
        lambda questions: [bool(shape.fails(question)) for question in questions],
        seed=seed,
        budget=budget,
        validation=30,
    )

    def right(cases: Sequence[Mapping[str, Any]]) -> float:
        if not cases:
            return math.nan
        answers = np.array([shape.fails(case) for case in cases])
        return balanced(learned.rule.predict(columns_of(variables, cases)), answers)

    # Exact: no mistake on 10,000 held-out cases, at and near the limits and on all asked ones (no proof of equality).
    more = [held_out(shape, variables, chance) for _ in range(9000)]
    near = near_limits(shape, variables, chance, 200)
    asked = [sample.assignment for sample in learned.samples]
    return _Run(
        text=learned.rule.text(),
        trials=learned.trials,
        accuracy=right(held),
        near=right(near),
        exact=right([*held, *more, *asked]) == 1 and not right(near) < 1,
        written=canonical(learned.rule.text()) in {canonical(text) for text in shape.texts},
        claimed=learned.balanced_accuracy if learned.checks else None,
        peers=_peers((number, seed, budget)) if peers else {},
    )


def rules_table(seeds: int, budgets: Sequence[int], first: int, jobs: int, only: Sequence[str]) -> list[Row]:
    rows = []
    numbers = [number for number, shape in enumerate(SHAPES) if not only or any(part in shape.name for part in only)]
    run = ProcessPoolExecutor(jobs).map if jobs > 1 else map
    for number in numbers:
        row: Row = {"rule": SHAPES[number].name}
        for budget in budgets:
            last = budget == max(budgets)
            runs = list(run(_learn, [(number, first + seed, budget, last) for seed in range(seeds)]))
            near = [one.near for one in runs if not math.isnan(one.near)]
            row[f"accuracy {budget}"] = f"{statistics.mean(one.accuracy for one in runs):.3f}"
            row[f"worst {budget}"] = f"{min(one.accuracy for one in runs):.3f}"
            row[f"near {budget}"] = f"{statistics.mean(near):.3f}" if near else "-"
            row[f"exact {budget}"] = f"{statistics.mean(one.exact for one in runs):.0%}"
            row[f"text {budget}"] = f"{statistics.mean(one.written for one in runs):.0%}"
            row[f"trials {budget}"] = spread([one.trials for one in runs])
            if last:
                row |= _mean([one.peers for one in runs])
                wrong = [one.text for one in runs if not one.written]
                row["a text"] = (wrong or [runs[0].text])[0][:200]
        rows.append(row)
        print(" ", row, file=sys.stderr, flush=True)
    last = f"{max(budgets)}"
    enough = sum(float(row[f"accuracy {last}"]) >= 0.99 for row in rows)
    print(f"{enough} of {len(rows)} shapes have an accuracy of at least 0.99 at {last} trials", file=sys.stderr)
    return rows


def _mean(found: Sequence[dict[str, float]]) -> Row:
    return {name: f"{statistics.mean(one[name] for one in found):.3f}" for name in PEERS}


def peers_table(seeds: int, budget: int, first: int, jobs: int) -> list[Row]:
    """Balanced accuracy of a decision tree and of product sets on held-out cases."""
    run = ProcessPoolExecutor(jobs).map if jobs > 1 else map
    rows = []
    for number, shape in enumerate(SHAPES):
        rows.append(
            {"rule": shape.name} | _mean(list(run(_peers, [(number, first + one, budget) for one in range(seeds)])))
        )
    return rows


# -- calibration ------------------------------------------------------------------------------------------------------


def _claims(number: int) -> dict[str, bool | None]:
    """Learn one rule with so few trials that it may be wrong; return which of its intervals miss the true rate.

    The truth is that of 6,000 cases of the distribution that the rates are stated for.
    """
    chance = random.Random(f"calibration {number}")
    shape = SHAPES[number % len(SHAPES)]
    variables = variables_of(shape, number)
    seen: list[tuple[Any, ...]] = []

    def near(table: Table, learnt: Any, sampler: Any, *rest: Any) -> Any:
        then = Table(table.variables)
        then.assignments, then.rows = list(table.assignments), list(table.rows)
        seen[:] = [(then, learnt, sampler)]
        return near_limit_cases(table, learnt, sampler, *rest)

    with patch.object(rules, "near_limits", near):
        learned = learn_rule(
            variables,
            lambda questions: [bool(shape.fails(question)) for question in questions],
            seed=number,
            budget=chance.choice((15, 30, 60)),
            validation=chance.choice((20, 30, 60)),
        )
    if not seen or not learned.checks:
        return {}
    table, learnt, sampler = seen[0]
    cases = near_limit_cases(table, learnt, sampler, chance, 3000)
    cases += [sampler.assignment(chance) for _ in range(len(cases) or 3000)]
    asked = {assignment_key(sample.assignment) for sample in learned.samples}
    cases = [case for case in cases if assignment_key(case) not in asked]
    if not cases:
        return {}
    inside = learned.rule.predict(columns_of(variables, cases))
    fails = np.array([bool(shape.fails(case)) for case in cases])
    found: dict[str, bool | None] = {"some mistakes": bool((inside != fails).any())}
    for name, claim, among in (("precision", learned.precision, inside), ("recall", learned.recall, fails)):
        rate = float((inside & fails).sum() / among.sum()) if among.any() else None
        found[name] = None if rate is None or claim.rate is None else not claim.low <= rate <= claim.high
    return found


def calibration_table(cases: int, jobs: int) -> list[Row]:
    """How often the true precision and recall of a rule lie outside of the stated intervals."""
    run = ProcessPoolExecutor(jobs).map if jobs > 1 else map
    found = list(run(_claims, range(cases)))
    rows = []
    for name in ("precision", "recall", "some mistakes"):
        told = [one[name] for one in found if one.get(name) is not None]
        rows.append({"claim": name, "claimed wrong at most": "5.0%" if name != "some mistakes" else "-"})
        rows[-1] |= {"wrong": f"{statistics.mean(map(bool, told)):.1%}", "claims": str(len(told))}
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1000, help="of the rules; the learner was tuned on 0..60")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only", choices=("minimize", "relevance", "rules", "peers", "calibration"))
    parser.add_argument("--budgets", type=int, nargs="+", default=[100, 200])
    parser.add_argument("--jobs", type=int, default=1, help="processes for the rules")
    parser.add_argument("--shapes", nargs="*", default=[], help="parts of the names of the rules to learn")
    parser.add_argument("--cases", type=int, default=504, help="of the calibration")
    arguments = parser.parse_args()
    tables = {
        "minimize": lambda: minimize_table(arguments.seeds),
        "relevance": lambda: relevance_table(arguments.seeds),
        "rules": lambda: rules_table(
            arguments.seeds, arguments.budgets, arguments.first_seed, arguments.jobs, arguments.shapes
        ),
        "peers": lambda: peers_table(arguments.seeds, max(arguments.budgets), arguments.first_seed, arguments.jobs),
        "calibration": lambda: calibration_table(arguments.cases, arguments.jobs),
    }
    result = {
        name: make()
        for name, make in tables.items()
        if arguments.only == name or (arguments.only is None and name != "peers")
    }
    for name, rows in result.items():
        show(f"{name} (trials: median/90th percentile, two pre-checks apart)" if name == "minimize" else name, rows)
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
