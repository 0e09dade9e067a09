"""Trials until a campaign finds planted faults, and until it has tried everything, on synthetic units.

Run `python benchmarks/campaign.py [--quick] [--seeds N] [--most TRIALS] [--only FAULT ...] [--kinds KIND ...] [--out
FILE]`. A unit is a function of the log that it gets: seven topics of JSON with 49 fields, and one planted fault. The
cost is the number of the trial whose failure was confirmed by fresh trials, which are not counted. What the campaign
needs stands beside uniform random values, dictionary sampling, and the campaign without covering, all of them run by
the same `run_campaign`.

Each result is a line of JSON in FILE as soon as it is there. The same command goes on after an interruption, and
`--table` prints what there is.
"""

from __future__ import annotations

import argparse
import itertools
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

from riot_bus.campaign.campaign import CampaignSettings, run_campaign
from riot_bus.campaign.covering import Covering
from riot_bus.campaign.malformed import malformations
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.targets import targets_of, with_observed
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.trial.unit_trial import behaviour_of
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
            (
                stamp,
                "mode",
                {
                    "mode": mode,
                    "previous": "auto",
                    "state": "idle",
                    "level": n % 3,
                    "phase": 2 if n == rounds * 3 // 4 else 1,
                },
            ),
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
    if topic != "battery" or voltage is None or voltage >= 0:
        return False
    case: TestCase = state["case"]
    return random.Random(f"{case.injections!r}:{case.again}").random() < 0.3


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


def window(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Currents that are far off all through the 0.4 s in which the unit measures its offset."""
    current = number(fields, "current")
    if topic == "battery" and 3.0 <= at < 3.4:
        state["off"] = state.get("off", 0) + (current is None or abs(current) > 1e3)
    return state.get("off", 0) >= 4


def while_mode(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A text that no state has, in a message whose phase is 2, as that of one message is."""
    return topic == "mode" and fields.get("phase") == 2 and fields.get("state") == ""


def after_mode(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A gear below zero while the phase that another topic has told last is 2."""
    if topic == "mode":
        state["phase"] = fields.get("phase")
    gear = number(fields, "gear", -1e4, 1e4)
    return topic == "cmd" and state.get("phase") == 2 and gear is not None and gear < 0


def two_bursts(state: State, topic: str, fields: Fields, at: float) -> bool:
    """A queue of twelve that survives one flood and not the next, half a second later or more."""
    if burst(state, topic, fields, at) and at > state.get("flooded", -1.0) + 0.5:
        state["floods"] = state.get("floods", 0) + 1
        state["flooded"] = at
    return state.get("floods", 0) >= 2


def sustained(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Ten slips in a row that are far from the usual; fewer are filtered out."""
    if topic == "odom":
        slip = number(fields, "slip")
        state["slips"] = state.get("slips", 0) + 1 if slip is None or abs(slip) > 1 else 0
    return state.get("slips", 0) >= 10


def some_lost(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Four gaps of a second's tenth or more between scans; single losses are made up for."""
    if topic == "scan":
        state["gaps"] = state.get("gaps", 0) + (at - state.get("scan", at) > 0.15)
        state["scan"] = at
    return state.get("gaps", 0) >= 4


def steps(state: State, topic: str, fields: Fields, at: float) -> bool:
    """Three steps that each show in the status: no known battery, a gear below zero meanwhile, and then no ranges."""
    gear = number(fields, "gear", -1e4, 1e4)
    if topic == "battery":
        state["status"] = "ok" if fields.get("kind") == "lipo" else "degraded"
    elif topic == "cmd" and state.get("status") != "ok" and gear is not None and gear < 0:
        state["status"] = "limp"
    return topic == "scan" and state.get("status") == "limp" and fields.get("ranges") == []


FAULTS: dict[str, Step] = {
    each.__name__: each
    for each in (
        value, two_fields, mode, order, missing, length, text_length, missing_key, null, wrong_type, truncated, wraps,
        stale, burst, at_times, in_a_row, beyond, other_field, late, window, while_mode, after_mode, two_bursts,
        sustained, some_lost, steps,
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
        state: State = {"case": case}
        outputs: list[Message] = []
        for position, message in enumerate(messages):
            fields = decoded(message.payload)
            fields = fields if isinstance(fields, dict) else {"": "malformed"}
            if not self.step(state, message.key, fields, (message.time - self.log[0].time) / 1e9):
                text = json.dumps({"mode": state.get("status", "ok")})
                outputs.append(Message(message.time, "status", text.encode(), encoding="application/json"))
            elif not self.robust:
                counts = {"played": min(len(messages), position + 1 + LATE), "outputs": len(outputs)}
                return Outcome(Verdict.FAIL, (CRASH,), statistics=counts | {"modified": len(case.injections)})
        shown = behaviour_of(outputs, REGISTRY) if "status" in state else {}
        counts = {"played": len(messages), "outputs": len(outputs), "behaviour": shown}
        return Outcome(Verdict.PASS, statistics=counts)


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
        run_campaign(unit.log, schedule, unit, CampaignSettings(seed=seed, trials=most), covering=covering, found=found)
    except _FoundError as error:
        return int(error.args[0])
    return None


@dataclass(frozen=True)
class Job:
    """What one process does: campaigns of a kind and seed on the units with each of these faults.

    Attributes:
        out: Gets a line for each as soon as it ends.
    """

    kind: str
    seed: int
    most: int
    names: tuple[str, ...]
    out: Path

    def run(self) -> None:
        """Run them."""
        log = nominal_log()
        kept: dict[tuple[Injection, ...], Sequence[Message]] = {}
        robust = self.kind == "robust twin"
        for name in self.names:
            unit = Unit(FAULTS[name], robust, log, kept)
            trials = trials_until_found(unit, "riot" if robust else self.kind, self.seed, self.most)
            row = {"kind": self.kind, "fault": name, "seed": self.seed, "most": self.most, "trials": trials}
            with self.out.open("a") as stream:  # one short write, so lines of several processes do not mix
                stream.write(json.dumps(row) + "\n")


@dataclass(frozen=True)
class CoverageJob:
    """The trials until all has been tried on a unit of so many fields."""

    fields: int
    faulty: bool
    seed: int
    out: Path

    def run(self) -> None:
        """Count them."""
        trials, total = coverage(self.fields, self.seed, faulty=self.faulty)
        row = {"kind": "coverage", "fields": self.fields, "faulty": self.faulty, "seed": self.seed}
        with self.out.open("a") as stream:
            stream.write(json.dumps(row | {"trials": trials, "total": total}) + "\n")


def carry_out(job: Job | CoverageJob) -> None:
    """Do a job, in a process of the pool."""
    logging.disable()  # injections that meet no field are said once each
    job.run()


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
    result = run_campaign(
        log, schedule, unit, CampaignSettings(seed=seed, trials=20_000, covered=True), covering=covering
    )
    return result.trials - 4, covering.total


# -- figures ----------------------------------------------------------------------------------------------------------


def median(values: Sequence[int | None], most: int) -> float:
    """Return the median, where what was not found counts as the budget."""
    return statistics.median(most if each is None else each for each in values)


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the results that there are; a line that an interruption has cut off counts as none."""
    found = []
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the figures of the results that there are, budget by budget."""
    lines = []
    kinds = (*SCHEDULES, "riot")
    for most in sorted({row["most"] for row in rows if row["kind"] in kinds}):
        lines.append(f"median trials until found, in brackets in how many campaigns of how many within {most}")
        lines.append(f"{'fault':>12}" + "".join(f"{kind:>18}" for kind in kinds) + "     robust twin")
        ratios: dict[str, list[float]] = {kind: [] for kind in SCHEDULES}
        for name in FAULTS:
            of_fault = [row for row in rows if row.get("fault") == name]
            trials = {
                kind: [row["trials"] for row in of_fault if row["kind"] == kind and row["most"] == most]
                for kind in kinds
            }
            cells = [
                f"{median(each, most):.0f} ({sum(one is not None for one in each)}/{len(each)})" if each else "-"
                for each in trials.values()
            ]
            twins = [row["trials"] for row in of_fault if row["kind"] == "robust twin"]
            alarms = f"{sum(one is not None for one in twins)} of {len(twins)}"
            if any(trials.values()):
                lines.append(f"{name:>12}" + "".join(f"{cell:>18}" for cell in cells) + f"{alarms:>16}")
            for kind in SCHEDULES:
                if trials[kind] and trials["riot"]:
                    ratios[kind].append(median(trials[kind], most) / median(trials["riot"], most))
        lines += [
            f"{kind}: {statistics.median(each):.1f} x as many trials (median of {len(each)} faults, unfound: budget)"
            for kind, each in ratios.items()
            if each
        ]
    covered: dict[tuple[int, bool], list[dict[str, Any]]] = {}
    for row in rows:
        if row["kind"] == "coverage":
            covered.setdefault((row["fields"], row["faulty"]), []).append(row)
    for (fields, faulty), found in sorted(covered.items()):
        name = f"{fields} fields, {'one that fails whatever it is' if faulty else 'robust'}"
        trials_each = ", ".join(str(row["trials"]) for row in found)
        lines.append(f"all {found[0]['total']} things tried, {name}: {trials_each} trials")
    return lines


def main() -> None:
    """Carry out what is missing, and print the figures."""
    kinds = (*SCHEDULES, "riot", "robust twin")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three seeds, 150 trials, no coverage")
    parser.add_argument("--seeds", type=int, help="campaigns of each kind [20]")
    parser.add_argument("--most", type=int, help="budget of trials [500]")
    parser.add_argument("--only", nargs="*", default=list(FAULTS), choices=list(FAULTS))
    parser.add_argument("--kinds", nargs="*", default=[*kinds, "coverage"], choices=[*kinds, "coverage"])
    parser.add_argument("--out", type=Path, default=Path("campaign.jsonl"), help="gets the results")
    parser.add_argument("--table", action="store_true", help="carry nothing out")
    options = parser.parse_args()
    seeds = options.seeds or (3 if options.quick else 20)
    most = options.most or (150 if options.quick else 500)
    known = {
        json.dumps({key: row[key] for key in row.keys() - {"trials", "total"}}, sort_keys=True)
        for row in rows_of(options.out)
    }
    jobs: list[Job | CoverageJob] = []
    for seed in range(seeds):  # seed by seed, so that what is there after an interruption can be compared
        for kind in (each for each in kinds if each in options.kinds):
            budget = ROBUST if kind == "robust twin" else most
            wanted = tuple(
                name
                for name in options.only
                if json.dumps({"fault": name, "kind": kind, "most": budget, "seed": seed}, sort_keys=True) not in known
            )
            jobs += [Job(kind, seed, budget, wanted, options.out)] if wanted else []
    for fields, faulty, seed in itertools.product((40, 200), (False, True), range(3)):
        key = json.dumps({"faulty": faulty, "fields": fields, "kind": "coverage", "seed": seed}, sort_keys=True)
        if "coverage" in options.kinds and not options.quick and key not in known:
            jobs.append(CoverageJob(fields, faulty, seed, options.out))
    if not options.table:
        if options.out.exists() and not options.out.read_bytes().endswith(b"\n"):
            with options.out.open("a") as stream:  # ends a line that an interruption has cut off
                stream.write("\n")
        with multiprocessing.Pool(2) as pool:
            for _ in pool.imap_unordered(carry_out, jobs, chunksize=1):
                pass
    print("\n".join(table(rows_of(options.out))))


if __name__ == "__main__":
    main()
