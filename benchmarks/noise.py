"""Minimise and relevance where trials are not reliable: how often they are right, and what that costs.

Run `python benchmarks/noise.py [--seeds N] [--only minimize] [--rates 1 0.9] [--false 0 0.01] [--json FILE]`; for
peers in the same run, `pip install picire "setuptools<81" shrinkray hypothesis`. A trial fails with probability p where
its input triggers the failure, else with probability eps. As in a campaign, each case has been confirmed by fresh
trials before (`campaign.confirm`); these are not counted. A result is right, wrong, or inconclusive, where the step
itself says that it has shown nothing. Trials: median/90th percentile of all seeds.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import show
from peers import PEERS, explained

from riot_bus.campaign.confirm import repeat
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.relevance import PASSING_STRAIGHT, FieldSpace, relevant_fields
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.trial import Outcome, Scalar, TestCase, Verdict, Violation

Row = dict[str, Any]

FAILURE = Violation("crash", "unit", "crash of unit")

SLOW = {"hypothesis": 3}
"""Seeds of peers that take a minute each; they are asked where answers are reliable, since others end them."""


@dataclass
class Unit:
    """A unit that fails with probability `p` where an input triggers the failure, else with `eps`."""

    p: float
    eps: float
    seed: int
    trials: int = 0
    chance: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.chance = random.Random(f"{self.p} {self.eps} {self.seed}")

    def answer(self, triggers: bool) -> bool:  # noqa: FBT001
        """Return whether one trial fails."""
        self.trials += 1
        return self.chance.random() < (self.p if triggers else self.eps)

    @property
    def parallelism(self) -> int:
        """How many confirmations run at once."""
        return 1

    def run(self, cases: Sequence[TestCase]) -> list[Outcome]:
        """Carry out trials of the failing case; they are not counted."""
        fails = (self.chance.random() < self.p for _ in cases)
        return [Outcome(Verdict.FAIL, (FAILURE,)) if failed else Outcome(Verdict.PASS) for failed in fails]

    def confirmed(self) -> tuple[int, int]:
        """Return how many of how many fresh trials of the failing case failed: a finding has at least one."""
        while True:
            rate = repeat(TestCase(), FAILURE.signature, self)
            if rate.hits:
                return rate.hits, rate.total


@dataclass
class Tally:
    """What became of all seeds."""

    right: int = 0
    wrong: int = 0
    inconclusive: int = 0
    trials: list[int] = field(default_factory=list)

    def add(self, trials: int, right: bool | None) -> None:  # noqa: FBT001
        """Count a result: right, wrong, or None if it is inconclusive."""
        self.trials.append(trials)
        self.right += right is True
        self.wrong += right is False
        self.inconclusive += right is None

    def row(self) -> Row:
        """Return the figures."""
        count = len(self.trials)
        return {
            "right": f"{self.right / count:.1%}",
            "wrong": f"{self.wrong / count:.1%}",
            "inconclusive": f"{self.inconclusive / count:.1%}",
            "trials": f"{statistics.median(self.trials):.0f}/{np.percentile(self.trials, 90):.0f}",
        }


# -- minimise ---------------------------------------------------------------------------------------------------------


def minimized(n: int, unit: Unit, triggers: Callable[[frozenset[int]], bool], needed: set[int] | None) -> bool | None:
    """Minimise; return whether it is right, None if it says that it does not know."""

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        return [unit.answer(triggers(frozenset(question))) for question in questions]

    try:
        found = minimize(n, ask, noise=Noise.after(*unit.confirmed(), nominal_total=4))
    except InconclusiveError:
        return None
    kept = frozenset(found.kept)
    if not found.one_minimal:
        return None
    if needed is not None:
        return kept == needed
    return triggers(kept) and not any(triggers(kept - {item}) for item in kept)


def minimize_row(n: int, needed: int, p: float, eps: float, seeds: int) -> Row:
    tally = Tally()
    for seed in range(seeds):
        wanted = wanted_of(n, needed, seed)
        unit = Unit(p, eps, seed)
        right = minimized(n, unit, wanted.issubset, wanted)
        tally.add(unit.trials, right)
    return {"log/needed": f"{n}/{needed}", "p": p, "eps": eps, **tally.row()}


def wanted_of(n: int, needed: int, seed: int) -> set[int]:
    return set(random.Random(seed * 7919 + n + needed).sample(range(n), needed))


def peers_row(n: int, needed: int, p: float, eps: float, seeds: int) -> Row:
    """Other minimisers on the same logs: trials, and how often they are right.

    They take an answer for the truth, so each of theirs is that of four trials where one may be wrong: whether any has
    failed, or more than one where trials also fail for nothing.
    """
    row: Row = {"log/needed": f"{n}/{needed}", "p": p, "eps": eps}
    times = 1 if p == 1 and not eps else 4
    for name, peer in PEERS.items():
        if name in SLOW and times > 1:
            continue
        tally = Tally()
        for seed in range(min(seeds, SLOW.get(name, seeds))):
            wanted = wanted_of(n, needed, seed)
            unit = Unit(p, eps, seed)

            def fails(kept: tuple[int, ...], unit: Unit = unit, wanted: set[int] = wanted) -> bool:
                hits = sum(unit.answer(wanted.issubset(kept)) for _ in range(times))
                return hits > (1 if eps else 0)

            try:
                right: bool | None = set(peer(n, fails)) == wanted
            except (AssertionError, ValueError):  # it finds that answers contradict each other
                right = None
            except ModuleNotFoundError as error:
                row[name] = str(error)
                break
            tally.add(unit.trials, right)
        if tally.trials:
            row[name] = tally.row()["trials"]
            row[f"{name} right"] = tally.row()["right"]
    return row


def explain_row(seeds: int) -> Row:
    """Hypothesis' explain phase on 50 fields, two of which matter, where answers are reliable."""
    tally = Tally()
    for seed in range(seeds):
        names = [f"f{index}" for index in range(50)]
        first, second = random.Random(seed * 31 + 50).sample(names, 2)
        unit = Unit(1.0, 0.0, seed)

        def fails(drawn: Mapping[str, int], unit: Unit = unit, first: str = first, second: str = second) -> bool:
            return unit.answer(drawn[first] < 0 and drawn[second] == 3)

        right = explained(names, fails, list(DRAWS), seed) == {first, second}
        tally.add(unit.trials, right)
    row = {"log/needed": "50 fields/2", "p": 1.0, "eps": 0.0}
    return row | {"hypothesis": tally.row()["trials"], "hypothesis right": tally.row()["right"]}


def suppressed_row(n: int, p: float, eps: float, seeds: int) -> Row:
    """Not monotone: what is needed is hidden by another message, unless a third one comes too (suppressor pairs)."""
    tally = Tally()
    for seed in range(seeds):
        chance = random.Random(seed * 104729 + n)
        needed = chance.sample(range(n), chance.choice((1, 2, 3)))
        rest = [item for item in range(n) if item not in needed]
        pairs = [tuple(chance.sample(rest, 2)) for _ in range(3)]

        def triggers(kept: frozenset[int], needed: list[int] = needed, pairs: list[Any] = pairs) -> bool:
            return kept.issuperset(needed) and not any(a in kept and b not in kept for a, b in pairs)

        unit = Unit(p, eps, seed)
        right = minimized(n, unit, triggers, None)
        tally.add(unit.trials, right)
    return {"log/needed": f"{n}, 3 suppressor pairs", "p": p, "eps": eps, **tally.row()}


# -- relevance --------------------------------------------------------------------------------------------------------

DRAWS = tuple(range(-5, 0)) + tuple(range(1, 6))


def relevance_row(n: int, relevant: int, kind: str, p: float, eps: float, seeds: int) -> Row:
    tally, straight, again, slow = Tally(), [], [], 0.0
    for seed in range(seeds):
        chance = random.Random(seed * 31 + n)
        names = [f"f{index}" for index in range(n)]
        wanted = chance.sample(names, relevant)
        fields = []
        for name in names:
            injected = name == wanted[0] or chance.random() < 0.02
            fields.append(FieldSpace(name, -1 if name == wanted[0] else 3, 4 if injected else None, DRAWS))
        unit = Unit(p, eps, seed)

        def triggers(question: Mapping[str, Scalar], wanted: list[str] = wanted) -> bool:
            values = [int(question[name]) for name in wanted]
            if kind == "parity":
                return values[0] * values[1] < 0
            # Modes at 50 %: half of the draws are such as the failure needs.
            return values[0] < 0 and all(value > 0 if kind == "modes at 50 %" else value == 3 for value in values[1:])

        def ask(questions: Sequence[Mapping[str, Scalar]], unit: Unit = unit) -> list[bool]:
            return [unit.answer(triggers(question)) for question in questions]

        begun, drawn = time.perf_counter(), 0
        doing: list[str] = []

        def tell(done: int, _total: int | None, what: str, doing: list[str] = doing) -> None:
            doing += [what] * (done - len(doing))

        try:
            known = Noise.after(*unit.confirmed(), nominal_total=4)
            found = relevant_fields(fields, ask, seed=seed, noise=known, progress=tell)
            right: bool | None = {one.name for one in found.fields} == set(wanted)
            right = right if found.complete else None
            drawn = found.straight + PASSING_STRAIGHT
            straight.append(drawn)
            again.append(doing.count("asking a draw again"))
        except InconclusiveError:
            right = None
        slow += time.perf_counter() - begun
        tally.add(unit.trials - drawn, right)
    shown = tally.row()
    shown["search"] = shown.pop("trials")
    name = f"{n}/{relevant}" + (f" {kind}" if kind else "")
    draws, repeats = (f"{statistics.median(one):.0f}" if one else "-" for one in (straight, again))
    return {
        "fields/relevant": name,
        "p": p,
        "eps": eps,
        **shown,
        "of these, draws asked again": repeats,
        "further draws": draws,
        "s each": f"{slow / seeds:.2f}",
    }


# -- calibration ------------------------------------------------------------------------------------------------------


def calibration_rows(seeds: int) -> list[Row]:
    """Of so many random cases: how often each claim is wrong, beside what was claimed.

    Rates of failure and false failures, what is needed, suppressor pairs, how often a field matters: all at random.
    """
    minimal, fields, rest = [0, 0], [0, 0], [0, 0]
    for seed in range(seeds):
        chance = random.Random(f"calibration {seed}")
        unit = Unit(chance.choice((1.0, 1.0, 0.95, 0.9, 0.7, 0.5, 0.3)), chance.choice((0.0, 0.0, 0.01)), seed)
        needed = set(chance.sample(range(200), chance.choice((1, 1, 2, 3))))
        pairs = [chance.sample([i for i in range(200) if i not in needed], 2) for _ in range(chance.choice((0, 0, 2)))]

        def triggers(kept: frozenset[int], needed: set[int] = needed, pairs: list[list[int]] = pairs) -> bool:
            return needed <= kept and not any(a in kept and b not in kept for a, b in pairs)

        right = minimized(200, unit, triggers, None)
        minimal[0] += right is False
        minimal[1] += right is not None
        for one, claims in zip((fields, rest), related(chance, unit, seed), strict=True):
            one[0] += claims[0]
            one[1] += claims[1]
    titles = ("minimal", "this field is relevant", "the others change at most 5 %")
    return [
        {"claim": title, "claimed wrong at most": "5.0%", "wrong": f"{wrong / max(1, count):.1%}", "claims": count}
        for title, (wrong, count) in zip(titles, (minimal, fields, rest), strict=True)
    ]


def related(chance: random.Random, unit: Unit, seed: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return for one random case the wrong and all claims about relevant fields, and about all others together."""
    names = [f"f{index}" for index in range(30)]
    wanted = chance.sample(names, chance.choice((1, 2, 3)))
    # Each of these heals the failure at so many of the ten values that are drawn; the first one, at its nominal value.
    heals = {name: chance.choice((10, 10, 5, 1)) for name in wanted[1:]}
    fields = [
        FieldSpace(name, -1 if name == wanted[0] else 0, 4 if name == wanted[0] else None, DRAWS) for name in names
    ]

    def triggers(question: Mapping[str, Scalar]) -> bool:
        bad = (DRAWS.index(int(question[name])) < count for name, count in heals.items() if question[name] != 0)
        return int(question[wanted[0]]) < 0 and not any(bad)

    def ask(questions: Sequence[Mapping[str, Scalar]]) -> list[bool]:
        return [unit.answer(triggers(question)) for question in questions]

    try:
        known = Noise.after(*unit.confirmed(), nominal_total=4)
        found = relevant_fields(fields, ask, seed=seed, noise=known)
    except InconclusiveError:
        return (0, 0), (0, 0)
    named = {one.name for one in found.fields}
    unchanged = 1.0
    for name in wanted:
        if name not in named:
            unchanged *= 0.5 if name == wanted[0] else 1 - heals[name] / 10
    return (len(named - set(wanted)), len(named)), (int(1 - unchanged > found.bound), int(found.straight > 0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--rates", type=float, nargs="+", default=[1.0, 0.9, 0.7, 0.3])
    parser.add_argument("--false", type=float, nargs="+", default=[0.0, 0.01])
    parser.add_argument("--only", choices=("minimize", "peers", "suppressed", "relevance", "calibration"))
    parser.add_argument("--sizes", type=int, nargs="+", default=[50, 500, 1000, 5000], help="of logs, and fields")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    noise = [(p, eps) for eps in arguments.false for p in arguments.rates]
    tables: dict[str, list[Callable[[float, float], Row]]] = {
        "minimize": [
            lambda p, eps, n=n, needed=needed: minimize_row(n, needed, p, eps, arguments.seeds)
            for n, needed in ((1000, 1), (1000, 3), (5000, 1), (5000, 3))
            if n in arguments.sizes
        ],
        "peers": [
            lambda p, eps, needed=needed: peers_row(1000, needed, p, eps, arguments.seeds)
            for needed in (1, 3)
            if 1000 in arguments.sizes
        ]
        + [lambda p, eps: explain_row(arguments.seeds) if p == 1 and not eps else {}],
        "suppressed": [lambda p, eps: suppressed_row(300, p, eps, arguments.seeds)],
        "relevance": [
            lambda p, eps, n=n, some=some, kind=kind: relevance_row(n, some, kind, p, eps, arguments.seeds)
            for n, some, kind in (
                (50, 2, ""),
                (50, 2, "parity"),
                (500, 3, ""),
                (5000, 3, ""),
                (5000, 4, "modes at 50 %"),
            )
            if n in arguments.sizes
        ],
    }
    result: dict[str, list[Row]] = {}
    if arguments.only in (None, "calibration"):
        result["calibration"] = calibration_rows(12 * arguments.seeds)
        show(f"calibration, {12 * arguments.seeds} cases", result["calibration"])
    for name, makers in tables.items():
        if arguments.only in (None, name):
            result[name] = []
            for make in makers:
                for p, eps in noise:
                    if row := make(p, eps):
                        result[name].append(row)
                        print(" ", row, file=sys.stderr, flush=True)
            show(name, result[name])
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
