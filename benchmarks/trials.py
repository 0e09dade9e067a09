"""Trials per second by how a trial gets its process, and whether all ways give the same verdicts.

`python benchmarks/trials.py [--jobs N ...] [--trials N] [--rounds N] [--json]`: a small Python unit that passes, fresh
and forked, and one that sleeps 0.2 s for each message, so its trials wait and hardly
compete for processors: they tell what workers cost each other. What comes before the first trials (baseline, starting
workers) is left out.

`--paired N [--units KIND ...]`: N cases on each of the misbehaving units of the tests, executed fresh (twice, which
tells what differs by chance) and forked.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.chain.base.workspace import Workspace
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from tests.systems.misbehaviour.catalogue import FAULTY, LIMITED, ROBUST, missing, write

if TYPE_CHECKING:
    from collections.abc import Sequence

WAYS = ("fresh", "auto")
UNITS = {**{f"echoes, {way}": ("echoes", way) for way in WAYS}, "sleeps": ("sleeps", "auto")}
VALUES = (3.25, 1e9, -1.0, float("nan"), "text", 0.5)
"""Of which half is bad for the misbehaving units."""
SLEEPS = """
import sys, time, zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
with zenoh.open(config) as session:
    def take(sample):
        time.sleep(0.2)
        session.put("state", sample.payload)
    subscriber = session.declare_subscriber("cmd", take)
    while True:
        time.sleep(60)
"""


def system_of(folder: Path, unit: str) -> Path:
    """Write the system of a unit; return the path of riot.toml."""
    if unit != "sleeps":
        return write(folder, [unit])
    (folder / "node.py").write_text(SLEEPS)
    with LogWriter(folder / "nominal.mcap") as log:
        for number in range(3):
            log.write(Message(10**18 + number, "cmd", b'{"x": 1}', encoding="application/json"))
    path = folder / "riot.toml"
    path.write_text(
        '[system]\nnominal = "nominal.mcap"\n[components.sleeps]\ncommand = ["{python}", "node.py", "{endpoint}"]\n'
        'inputs = ["cmd"]\noutputs = ["state"]\n[unit.sleeps]\nmined = false\nsettle = { window = 0.3 }\n'
    )
    return path


def set_way(path: Path, unit: str, way: str) -> Path:
    """Write into riot.toml how trials of a unit get their process."""
    head = f"[unit.{unit}]\n"
    path.write_text(path.read_text().replace(head, f'{head}isolation = "{way}"\n'))
    return path


def measure(unit: str, way: str, jobs: int, trials: int) -> float:
    """Return the trials per second of so many workers, while all of them work."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with Workspace(set_way(system_of(folder, unit), unit, way), folder / "out", jobs=jobs) as workspace:
            log = workspace.unit_log(unit)
            runner = workspace.runners.unit(unit, lambda: log)
            ends: list[float] = []

            def ended(_: int, outcome: Outcome) -> None:
                if outcome.verdict is not Verdict.PASS:
                    raise RuntimeError(f"{unit}: {outcome.verdict}: {outcome.detail or outcome.violations}")
                ends.append(time.monotonic())

            runner.run([TestCase(log, seed=-1 - number) for number in range(2 * jobs)])
            runner.each([TestCase(log, seed=number) for number in range(trials + 2 * jobs)], ended)  # type: ignore[attr-defined]
            return trials / (ends[trials + jobs - 1] - ends[jobs - 1])


def verdicts(unit: str, way: str, cases: int, jobs: int) -> list[str]:
    """Return the verdict and signatures of each case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with Workspace(set_way(write(folder, [unit]), unit, way), folder / "out", jobs=jobs) as workspace:
            log = workspace.unit_log(unit)
            runner = workspace.runners.unit(unit, lambda: log)
            ordered = workspace.runners.baseline(unit, lambda: log).ordered
            asked = [
                TestCase(
                    log, (Injection("cmd", "x", VALUES[number % len(VALUES)], first=at, last=at),), ordered=ordered
                )
                for number in range(cases)
                for at in [number * 7 % 30]
            ]
            outcomes = runner.run(asked)
        return [
            " | ".join([one.verdict.value, *sorted({each.signature for each in one.violations})]) for one in outcomes
        ]


def paired(units: Sequence[str], cases: int, jobs: int) -> None:
    """Print how often each way gives another verdict than fresh processes."""
    total = dict.fromkeys(("fresh again", "auto"), 0)
    for unit in units:
        fresh = verdicts(unit, "fresh", cases, jobs)
        line = [f"{unit:18} {cases} cases, {sum(not each.startswith('pass') for each in fresh)} fail; others:"]
        for way in total:
            found = verdicts(unit, way.partition(" ")[0], cases, jobs)
            differ = [(one, other) for one, other in zip(fresh, found, strict=True) if one != other]
            total[way] += len(differ)
            line.append(f"{way} {len(differ)}")
            line += [f"\n    {one!r} became {other!r}" for one, other in dict.fromkeys(differ)]
        print(*line, flush=True)
    print(f"of {cases * len(units)} cases differ from fresh ones: {total}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2, 4, 8], help="workers")
    parser.add_argument("--trials", type=int, default=20, help="trials of each worker")
    parser.add_argument("--rounds", type=int, default=1, help="measured so often, by turns; the best counts")
    parser.add_argument("--paired", type=int, default=0, help="cases of each unit whose verdicts are compared")
    parser.add_argument("--units", nargs="+", help="kinds of misbehaving units to compare, instead of all")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    if options.paired:
        able = [kind for kind in (*FAULTY, *ROBUST) if not missing(kind) and kind not in LIMITED]
        paired(options.units or able, options.paired, options.jobs[0])
        return
    found = {unit: dict.fromkeys(options.jobs, 0.0) for unit in UNITS}
    for _ in range(options.rounds):
        for unit, rates in found.items():
            for jobs in rates:
                rates[jobs] = max(rates[jobs], measure(*UNITS[unit], jobs, options.trials * jobs))
    if options.json:
        print(json.dumps(found))
        return
    for unit, rates in found.items():
        base = rates[options.jobs[0]] / options.jobs[0]
        for jobs, rate in rates.items():
            print(f"{unit:18} {jobs:2} workers: {rate:6.1f} trials/s, {rate / base / jobs:.2f} of linear")


if __name__ == "__main__":
    main()
