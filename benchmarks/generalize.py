"""Trials that generalisation takes on synthetic systems: minimise, relevance, rules.

Run `python benchmarks/generalize.py [--seeds N] [--json FILE]`. The cost is the number of trials, beside a baseline
written here: ddmin, one field at a time, and a decision tree on dictionary samples.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.generalize.features import features_of
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.relevance import FieldSpace, relevant_fields
from riot_bus.generalize.rules import Variable, learn_rule
from riot_bus.generalize.sampling import columns_of, integer_range, interesting
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

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Shape:
    """One kind of rule: what fails, and the variables with type, failing value and nominal range."""

    name: str
    fails: Callable[[Values], bool]
    variables: tuple[tuple[str, str, Any, Any, Any], ...]


def quotient(a: float, b: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


INT_MAX = 2**31 - 1
SHAPES = (
    Shape(
        "x*y<0 or >1e6, float",
        lambda v: v["x"] * v["y"] < 0 or v["x"] * v["y"] > 1e6,
        (("x", "float64", -1.0, 1.0, 400.0), ("y", "float64", 20.0, 1.0, 400.0)),
    ),
    Shape(
        "x*y<0 or >1e6, int",
        lambda v: v["x"] * v["y"] < 0 or v["x"] * v["y"] > 10**6,
        (("x", "int32", -1, 1, 400), ("y", "int32", 20, 1, 400)),
    ),
    Shape("x>1000", lambda v: v["x"] > 1000, (("x", "float64", 1e6, 0.0, 10.0), ("y", "float64", 2.0, 0.0, 10.0))),
    Shape(
        "non-finite",
        lambda v: not math.isfinite(v["x"]),
        (("x", "float64", math.nan, 0.0, 10.0), ("y", "int32", 3, 0, 9)),
    ),
    Shape(
        "|x|>50 and mode==2",
        lambda v: abs(v["x"]) > 50 and v["mode"] == 2,
        (("x", "float64", 1e6, -5.0, 5.0), ("mode", "int32", 2, 0, 4)),
    ),
    Shape("x-y>10", lambda v: v["x"] - v["y"] > 10, (("x", "float64", 1e6, 0.0, 5.0), ("y", "float64", 2.0, 0.0, 5.0))),
    Shape(
        "hypot>200",
        lambda v: math.hypot(v["x"], v["y"]) > 200,
        (("x", "float64", 1e6, 0.0, 50.0), ("y", "float64", 2.0, 0.0, 50.0)),
    ),
    Shape(
        "index out of 0..w",
        lambda v: v["i"] < 0 or v["i"] >= v["w"],
        (("i", "int32", -1, 0, 99), ("w", "int32", 200, 100, 400)),
    ),
    Shape("n==0", lambda v: v["n"] == 0, (("n", "uint32", 0, 1, 400), ("y", "float64", 2.0, 0.0, 50.0))),
    Shape(
        "w*h>2^31",
        lambda v: v["w"] * v["h"] > 2**31,
        (("w", "uint32", 2**32 - 1, 1, 2000), ("h", "uint32", 480, 1, 2000)),
    ),
    Shape(
        "box and range",
        lambda v: 100 < v["x"] < 1000 and v["y"] > 50,
        (("x", "float64", 500.0, 0.0, 50.0), ("y", "float64", 60.0, 0.0, 100.0)),
    ),
    Shape(
        "x<0 or nan",
        lambda v: v["x"] < 0 or math.isnan(v["x"]),
        (("x", "float64", -1.0, 0.0, 10.0), ("y", "float64", 2.0, 0.0, 10.0)),
    ),
    Shape(
        "x*y<0 and mode",
        lambda v: v["x"] * v["y"] < 0 and v["mode"] == "auto",
        (
            ("x", "int32", -1, 1, 400),
            ("y", "int32", 20, 1, 400),
            ("mode", "string", "auto", ("auto", "manual", "off"), 0),
        ),
    ),
    Shape(
        "a/b>100",
        lambda v: quotient(v["a"], v["b"]) > 100,
        (("a", "float64", 1e6, 0.0, 50.0), ("b", "float64", 2.0, 1.0, 50.0)),
    ),
)


def variables_of(shape: Shape, seed: int) -> list[Variable]:
    chance = random.Random(seed + 1)
    found = []
    for name, type_, failing, low, high in shape.variables:
        nominal: tuple[Scalar, ...]
        if isinstance(low, tuple):
            nominal = tuple(chance.choice(low) for _ in range(20)) + low
        elif type_.startswith("float"):
            nominal = tuple(round(chance.uniform(low, high), 3) for _ in range(20))
        else:
            nominal = tuple(chance.randint(low, high) for _ in range(20))
        dictionary: tuple[Scalar, ...] = ()
        if type_.startswith("float"):
            dictionary = (0.0, -1.0, 1.0, 1e-9, 1e6, -1e6, math.nan, math.inf, -math.inf, 1e300, -1e300)
        elif type_.startswith("int"):
            dictionary = (0, 1, -1, 100, 65535, INT_MAX, -INT_MAX - 1)
        elif type_.startswith("uint"):
            dictionary = (0, 1, 100, 65535, INT_MAX, 2 * INT_MAX + 1)
        found.append(Variable(name, type_, failing, nominal[:1], nominal, dictionary))
    return found


def held_out(variables: Sequence[Variable], chance: random.Random) -> dict[str, Scalar]:
    """Draw nominal range, dictionary or log-uniform over the type; on purpose not the sampler that the learner uses."""
    found: dict[str, Scalar] = {}
    for variable in variables:
        kind, sign = chance.randrange(3), chance.choice((-1, 1))
        limits = integer_range(variable.type)
        if kind == 0 or variable.type in ("string", "bool", "bytes"):
            low, high = chance.choice(variable.nominal), chance.choice(variable.nominal)
            numbers = isinstance(low, int | float) and isinstance(high, int | float)
            value = low + (high - low) * chance.random() if numbers else low  # type: ignore[operator]
            found[variable.name] = round(value) if limits and isinstance(value, float) else value
        elif kind == 1:
            found[variable.name] = chance.choice(variable.dictionary)
        elif limits:
            size = int(2 ** (chance.random() * limits[1].bit_length()))
            found[variable.name] = max(limits[0], min(limits[1], sign * size if limits[0] else size))
        else:
            found[variable.name] = (
                sign * 10 ** chance.uniform(-300, 300)
                if chance.random() < 0.5
                else (sign * 10 ** chance.uniform(-2, 6))
            )
    return found


def balanced(predicted: Any, truth: Any) -> float:
    rates = [float((predicted == truth)[truth == side].mean()) for side in (True, False) if (truth == side).any()]
    return sum(rates) / len(rates)


def tree_accuracy(shape: Shape, variables: list[Variable], seed: int, budget: int, held: Any, truth: Any) -> float:
    """Decision tree on derived features of samples from dictionary and nominal values."""
    from sklearn.tree import DecisionTreeClassifier

    chance = random.Random(seed)
    samples = [{v.name: chance.choice(interesting(v)) for v in variables} for _ in range(budget)]
    features = features_of({v.name: v.type for v in variables})
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


def rules_table(seeds: int, budgets: Sequence[int], first: int) -> list[Row]:
    rows = []
    for shape in SHAPES:
        row: Row = {"rule": shape.name}
        trees = []
        for budget in budgets:
            scores, exact, example, used = [], 0, "", []
            for seed in range(first, first + seeds):
                variables = variables_of(shape, seed)
                chance = random.Random(seed + 10_000)
                held = [held_out(variables, chance) for _ in range(1000)]
                truth = np.array([shape.fails(sample) for sample in held])

                def ask(questions: Sequence[Values], shape: Shape = shape) -> list[bool]:
                    return [shape.fails(question) for question in questions]

                learned = learn_rule(variables, ask, seed=seed, budget=budget, validation=30)
                used.append(learned.trials)
                scores.append(balanced(learned.rule.predict(columns_of(variables, held)), truth))
                # Exact: no mistake on 10,000 held-out samples and all asked ones (not a proof of equality).
                more = [held_out(variables, chance) for _ in range(9000)]
                asked = [sample.assignment for sample in learned.samples]
                every = held + more + asked
                answers = np.array([shape.fails(sample) for sample in every])
                hit = bool((learned.rule.predict(columns_of(variables, every)) == answers).all())
                exact += hit
                example = example if example and hit else learned.rule.text()
                if budget == max(budgets):
                    trees.append(tree_accuracy(shape, variables, seed, budget, held, truth))
            row[f"accuracy {budget}"] = f"{statistics.mean(scores):.3f}"
            row[f"exact {budget}"] = f"{exact / seeds:.0%}"
            row[f"worst {budget}"] = f"{min(scores):.3f}"
            row[f"trials {budget}"] = spread(used)
        row["tree"] = f"{statistics.mean(trees):.3f}"
        row["last rule"] = example
        rows.append(row)
        print(" ", row, file=sys.stderr, flush=True)
    return rows


def show(title: str, rows: list[Row]) -> None:
    print(f"\n## {title}\n")
    heads = list(rows[0])
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for row in rows:
        print("| " + " | ".join(str(row[head]) for head in heads) + " |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1000, help="of the rules; the learner was tuned on 0..60")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only", choices=("minimize", "relevance", "rules"))
    parser.add_argument("--budgets", type=int, nargs="+", default=[50, 100, 200])
    arguments = parser.parse_args()
    tables = {
        "minimize": lambda: minimize_table(arguments.seeds),
        "relevance": lambda: relevance_table(arguments.seeds),
        "rules": lambda: rules_table(max(1, arguments.seeds // 4), arguments.budgets, arguments.first_seed),
    }
    result = {name: make() for name, make in tables.items() if arguments.only in (None, name)}
    for name, rows in result.items():
        show(f"{name} (trials: median/90th percentile, two pre-checks apart)" if name == "minimize" else name, rows)
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
