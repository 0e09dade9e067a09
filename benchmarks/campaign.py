"""Trials until a campaign finds planted faults, and until it has tried everything, on synthetic units.

Run `python benchmarks/campaign.py [--seeds N] [--most TRIALS] [--only FAULT ...] [--json FILE]`. A unit is a function
of the log that it gets: seven topics of JSON with 48 fields, and one planted fault. The cost is the number of the trial
whose failure was confirmed by fresh trials, which are not counted. What the campaign needs stands beside uniform random
values, dictionary sampling, and the campaign without covering, all of them run by the same `run_campaign`.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import multiprocessing
import random
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.campaign.campaign import run_campaign
from riot_bus.campaign.covering import Covering
from riot_bus.campaign.malformed import malformations
from riot_bus.campaign.observed import with_observed
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of, targets_of
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

Fields = dict[str, Any]
State = dict[str, Any]
REGISTRY = TypeRegistry()
CRASH = Violation("crash", "part", "crash in part")
ROBUST = 100
"""Trials of each robust twin."""
LATE = 5
"""Messages that are sent after the one that fails, before that is noticed."""


# -- units ------------------------------------------------------------------------------------------------------------


def nominal_log(rounds: int = 40) -> tuple[Message, ...]:
    """Return the log: a configuration, then six topics at 10 Hz, whose stamps are their times."""
    found: list[tuple[float, str, Fields]] = [(0.0, "config", {"rate": 10, "timeout": 1.5, "name": "unit", "on": True})]
    for n in range(rounds):
        stamp = 1.0 + n / 10
        mode = "dock" if rounds * 0.4 <= n < rounds * 0.6 else "auto"
        found += [
            (stamp, "mode", {"mode": mode, "previous": "auto", "state": "idle", "level": n % 3}),
            (
                stamp + 0.01,
                "odom",
                {
                    "stamp": stamp,
                    "x": 0.1 * n,
                    "y": 2.0,
                    "z": 0.0,
                    "vx": 1.0,
                    "vy": 0.0,
                    "yaw": 0.1,
                    "ticks": 20 + n % 5,
                    "slip": 0.01,
                },
            ),
            (
                stamp + 0.02,
                "cmd",
                {"speed": 1.5, "steer": 0.2, "gear": 2, "brake": False, "limit": 3.0, "source": "ui", "id": n},
            ),
            (
                stamp + 0.03,
                "scan",
                {
                    "ranges": [1.0 + 0.1 * i for i in range(8)],
                    "low": 0.1,
                    "high": 30.0,
                    "count": 8,
                    "angle": -1.57,
                    "step": 0.4,
                },
            ),
            (
                stamp + 0.04,
                "map",
                {"width": 20, "height": 30, "cell": 0.05, "x": 0.5, "y": 1.5, "layer": 1, "label": "floor", "known": 3},
            ),
            (
                stamp + 0.05,
                "battery",
                {
                    "voltage": 12.6,
                    "current": 3.1,
                    "percent": 80,
                    "cells": 4,
                    "low": 20,
                    "full": 90,
                    "kind": "lipo",
                    "index": n % 4,
                    "charging": False,
                },
            ),
        ]
    return tuple(
        Message(10**18 + round(at * 1e9), topic, json.dumps(fields).encode(), encoding="application/json")
        for at, topic, fields in found
    )


@cache
def decoded(payload: bytes) -> Any:
    """Return the document, None if it is none."""
    try:
        return json.loads(payload)
    except ValueError:
        return None


def number(fields: Fields, name: str, low: float = -math.inf, high: float = math.inf) -> float | None:
    """Return a field that is a number within limits, else None: the part of a unit that checks its inputs."""
    value = fields.get(name)
    good = isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
    return value if good else None


Step = Callable[[State, str, Fields, float], bool]
"""Takes in a message (state of the unit, topic, fields, seconds) and returns whether the fault is met."""


def value(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A speed that is not a number."""
    speed = fields.get("speed")
    return topic == "cmd" and isinstance(speed, float) and speed != speed


def two_fields(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Width and height are each checked, their product wraps."""
    width, height = number(fields, "width", 1, 65536), number(fields, "height", 1, 65536)
    return topic == "map" and None not in (width, height) and width * height >= 1 << 27


def mode(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A limit that is only harmful in the mode that an earlier message has set."""
    if topic == "mode" and fields.get("mode") in ("auto", "dock"):
        state["mode"] = fields["mode"]
    limit = number(fields, "limit")
    return topic == "cmd" and state.get("mode") == "dock" and limit is not None and limit < -1e3


def order(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A command comes after its successor."""
    before, now = state.get("id", -1), number(fields, "id", 0, 1000)
    if topic != "cmd" or now is None:
        return False
    state["id"] = now
    return now == before - 1


def missing(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Commands come before any configuration."""
    state["configured"] = state.get("configured") or topic == "config"
    return topic == "cmd" and not state["configured"]


def length(state: State, topic: str, fields: Fields, at: float) -> bool:
    """No range at all, of which the least is taken."""
    return topic == "scan" and fields.get("ranges") == []


def text_length(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A label that a buffer of 256 bytes cannot hold."""
    return topic == "map" and isinstance(fields.get("label"), str) and len(fields["label"]) >= 256


def missing_key(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A key that is always there is not."""
    return topic == "battery" and "cells" not in fields


def null(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Null where there is always a number."""
    return topic == "scan" and "angle" in fields and fields["angle"] is None


def wrong_type(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Text where there is always a number."""
    return topic == "odom" and isinstance(fields.get("yaw"), str)


def truncated(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A payload that ends too early."""
    return topic == "map" and fields.get("") == "malformed"


def wraps(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Each count of ticks is checked, their sum wraps in 32 bits."""
    state["ticks"] = state.get("ticks", 0) + (number(fields, "ticks", 0, 1 << 31) or 0) * (topic == "odom")
    return state["ticks"] >= 1 << 32


def stale(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A stamp that is older than the one before by more than a second."""
    stamp, before = number(fields, "stamp", 0, 1e10), state.get("stamp", 0.0)
    if topic != "odom" or stamp is None:
        return False
    state["stamp"] = stamp
    return stamp < before - 1.0


def burst(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A queue of twelve has no room for what comes within 50 ms."""
    recent = state.setdefault("recent", [])
    if topic == "scan":
        recent[:] = [*(time for time in recent if time > at - 0.05), at]
    return len(recent) > 12


def at_times(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A voltage below zero, three times of ten."""
    voltage = number(fields, "voltage")
    return topic == "battery" and voltage is not None and voltage < 0 and bool(state["lucky"] < 0.3)


def in_a_row(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Three velocities in a row that are none."""
    if topic == "odom":
        bad = isinstance(fields.get("vx"), float) and not abs(fields["vx"]) < 1e6
        state["bad"] = state.get("bad", 0) + 1 if bad else 0
    return state.get("bad", 0) >= 3


def beyond(state: State, topic: str, fields: Fields, at: float) -> bool:
    """An index that is one beyond the last cell; all others are refused."""
    return topic == "battery" and number(fields, "index", 4, 4) is not None


def other_field(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A mode that only another field of the message has."""
    return topic == "mode" and fields.get("mode") == "idle"


def late(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Nothing comes on a topic for a third of a second."""
    before = state.get("seen", at)
    if topic == "odom":
        state["seen"] = at
    return topic == "odom" and at - before > 0.33


FAULTS: dict[str, Step] = {
    each.__name__: each
    for each in (
        value, two_fields, mode, order, missing, length, text_length, missing_key, null, wrong_type, truncated, wraps,
        stale, burst, at_times, in_a_row, beyond, other_field, late,
    )
}  # fmt: skip


@dataclass
class Unit:
    """A runner: the unit with a fault; its robust twin refuses the message that the other one fails on.

    Attributes:
        delivered: What injections make of the log, kept for all faults.
    """

    step: Step
    robust: bool
    log: tuple[Message, ...]
    delivered: dict[tuple[Injection, ...], Sequence[Message]] = field(default_factory=dict)
    parallelism: int = 2

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases."""
        return [self.trial(case) for case in cases]

    def trial(self, case: TestCase) -> Outcome:
        """Execute one case."""
        messages = self.delivered.get(case.injections)
        if messages is None:
            messages, _ = inject_log(self.log, case.injections, registry=REGISTRY)
            self.delivered[case.injections] = messages
        state: State = {"lucky": random.Random(f"{case.injections!r}:{case.again}").random()}
        outputs = 0
        for position, message in enumerate(messages):
            fields = decoded(message.payload)
            fields = fields if isinstance(fields, dict) else {"": "malformed"}
            if not self.step(state, message.key, fields, (message.time - self.log[0].time) / 1e9):
                outputs += 1
            elif not self.robust:
                counts = {"played": min(len(messages), position + 1 + LATE), "outputs": outputs}
                return Outcome(Verdict.FAIL, (CRASH,), statistics=counts | {"modified": len(case.injections)})
        return Outcome(Verdict.PASS, statistics={"played": len(messages), "outputs": outputs})


# -- campaigns --------------------------------------------------------------------------------------------------------


class Uniform(Schedule):
    """One field per trial, on a stretch of messages, with a random value of its type."""

    def injections(self, trial: int) -> tuple[Injection, ...]:
        """Return the injection of a trial."""
        draw = random.Random(f"{self._seed}:{trial}")
        target = draw.choice(
            [each for families in self._families.values() for one in families.values() for each in one]
        )
        return stretched(draw, target.topic, target.path, self.draw(draw, target.type), target.messages)

    def draw(self, draw: random.Random, kind: str) -> Any:
        """Return a value of a type."""
        if kind == "bool":
            return draw.random() < 0.5
        if kind == "int64":
            return draw.randrange(-(1 << 63), 1 << 63)
        if kind == "float64":
            return draw.uniform(-1e9, 1e9)
        return "".join(chr(draw.randrange(32, 127)) for _ in range(draw.randrange(64)))


class Plain(Schedule):
    """One field per trial, on a stretch of messages, with one of the values that the dictionary has for it."""

    def injections(self, trial: int) -> tuple[Injection, ...]:
        """Return the injection of a trial."""
        draw = random.Random(f"{self._seed}:{trial}")
        target = draw.choice(
            [each for families in self._families.values() for one in families.values() for each in one]
        )
        return stretched(draw, target.topic, target.path, draw.choice(self._values(target)).value, target.messages)


def stretched(draw: random.Random, topic: str, path: str, value: Any, messages: int) -> tuple[Injection, ...]:
    """Return an injection on messages in a row, as many as `Schedule` takes."""
    length = max(1, round(messages ** draw.random()))
    first = draw.randrange(messages - length + 1)
    return (Injection(topic, path, value, first=first, last=first + length - 1),)


@cache
def parts(log: tuple[Message, ...]) -> tuple[Any, Any, Any]:
    """Return the targets of a log without and with what it tells of values, and the dictionary."""
    targets = targets_of(log, REGISTRY)
    return targets, with_observed(targets, log, REGISTRY), load_dictionary()


def covering_of(log: tuple[Message, ...], seed: int) -> tuple[Schedule, Covering]:
    """Return what `riot test` tries on a log."""
    _, observed, dictionary = parts(log)
    schedule = Schedule(observed, dictionary, seed=seed)
    items = [*schedule.items(), *message_faults(log, REGISTRY), *malformations(log, REGISTRY)]
    return schedule, Covering(items, positions_of(log, REGISTRY), seed=seed)


SCHEDULES: Mapping[str, type[Schedule]] = {"uniform": Uniform, "dictionary": Plain, "drawn": Schedule}


class _FoundError(Exception):
    pass


def trials_until_found(unit: Unit, kind: str, seed: int, most: int) -> int | None:
    """Return the number of the trial whose failure was confirmed, None if there was none."""
    covering = None
    if kind not in SCHEDULES:
        schedule, covering = covering_of(unit.log, seed)
    else:
        targets, _, dictionary = parts(unit.log)
        schedule = SCHEDULES[kind](targets, dictionary, seed=seed)

    def found(failure: Any) -> None:
        raise _FoundError(failure.trial + 1)

    try:
        run_campaign(unit.log, schedule, unit, seed=seed, trials=most, covering=covering, found=found)
    except _FoundError as error:
        return int(error.args[0])
    return None


def one_seed(job: tuple[int, int, tuple[str, ...]]) -> dict[str, dict[str, int | None]]:
    """Return the trials until each fault is found, by kind of campaign and fault."""
    seed, most, names = job
    log = nominal_log()
    found: dict[str, dict[str, int | None]] = {}
    for kind in (*SCHEDULES, "riot", "robust twin"):
        kept: dict[tuple[Injection, ...], Sequence[Message]] = {}
        budget, robust = (ROBUST, True) if kind == "robust twin" else (most, False)
        found[kind] = {
            name: trials_until_found(Unit(FAULTS[name], robust, log, kept), kind, seed, budget) for name in names
        }
    return found


def wide_log(fields: int, topics: int, messages: int) -> tuple[Message, ...]:
    """Return a log of topics whose messages have numbers, texts and truth values."""
    kinds: tuple[Any, ...] = (1.5, 7, "text", True)
    return tuple(
        Message(
            10**18 + n * 10**6,
            f"t{n % topics}",
            json.dumps({f"f{i}": kinds[i // topics % 4] for i in range(n % topics, fields, topics)}).encode(),
            encoding="application/json",
        )
        for n in range(messages)
    )


def coverage(fields: int, seed: int, *, faulty: bool) -> tuple[int, int]:
    """Return the trials until all has been tried on a unit with so many fields, and how many things that is.

    The faulty unit fails whatever value one of its fields has but the nominal one.
    """
    log = wide_log(fields, max(4, fields // 10), 2000)
    schedule, covering = covering_of(log, seed)

    def bad(state: State, topic: str, fields: Fields, at: float) -> bool:
        return topic == "t1" and fields.get("f1") != 1.5

    unit = Unit(bad, not faulty, log)
    result = run_campaign(log, schedule, unit, seed=seed, trials=20_000, covering=covering, covered=True)
    return result.trials - 4, covering.total


# -- figures ----------------------------------------------------------------------------------------------------------


def median(values: Sequence[int | None], most: int) -> float:
    """Return the median, where what was not found counts as the budget."""
    return statistics.median(most if each is None else each for each in values)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--most", type=int, default=500, help="budget of trials")
    parser.add_argument("--only", nargs="*", default=list(FAULTS), choices=list(FAULTS))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    logging.disable()  # injections that meet no field are said once each
    jobs = [(seed, options.most, tuple(options.only)) for seed in range(options.seeds)]
    with multiprocessing.Pool(2) as pool:
        seeds = pool.map(one_seed, jobs, chunksize=1)
    kinds = (*SCHEDULES, "riot")
    print(f"median trials until found, over {options.seeds} seeds, in brackets how often within {options.most}")
    print(f"{'fault':>12}" + "".join(f"{kind:>16}" for kind in kinds) + "     robust twin")
    figures: dict[str, Any] = {"seeds": options.seeds, "most": options.most, "faults": {}}
    for name in options.only:
        row = {kind: [each[kind][name] for each in seeds] for kind in (*kinds, "robust twin")}
        figures["faults"][name] = row
        cells = [(median(row[kind], options.most), sum(each is not None for each in row[kind])) for kind in kinds]
        alarms = sum(each is not None for each in row["robust twin"])
        print(f"{name:>12}" + "".join(f"{middle:>10.0f} ({hits:>3})" for middle, hits in cells) + f"{alarms:>16}")
    for kind in SCHEDULES:
        rates = [
            median(row[kind], options.most) / median(row["riot"], options.most) for row in figures["faults"].values()
        ]
        figures[f"{kind} / riot"] = statistics.median(rates)
        print(f"{kind}: {statistics.median(rates):.1f} times as many trials (median over faults; unfound: the budget)")
    figures["coverage"] = {}
    for fields in (40, 200):
        for faulty in (False, True):
            found = [coverage(fields, seed, faulty=faulty) for seed in range(3)]
            name = f"{fields} fields, {'one that fails whatever it is' if faulty else 'robust'}"
            figures["coverage"][name] = found
            print(f"all {found[0][1]} things tried, {name}: {', '.join(str(trials) for trials, _ in found)} trials")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
