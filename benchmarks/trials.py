"""Trials per second of 1, 2, 4 and 8 workers: a small Python unit that passes, and one that sleeps.

Run `python benchmarks/trials.py [--jobs N ...] [--trials N] [--rounds N] [--json]`. The second unit sleeps 0.2 s for
each message, so its trials wait and hardly compete for processors: they tell what workers cost each other. What comes
before the first trials (baseline, starting workers) is left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.chain.workspace import Workspace
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from tests.systems.misbehaviour.catalogue import write

UNITS = ("echoes", "sleeps")
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
        return write(folder)
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


def measure(unit: str, jobs: int, trials: int) -> float:
    """Return the trials per second of so many workers, while all of them work."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with Workspace(system_of(folder, unit), folder / "out", jobs=jobs) as workspace:
            runner = workspace.runners.unit(unit, lambda: workspace.unit_log(unit))
            log = workspace.unit_log(unit)
            ends: list[float] = []

            def ended(_: int, outcome: Outcome) -> None:
                if outcome.verdict is not Verdict.PASS:
                    raise RuntimeError(f"{unit}: {outcome.verdict}: {outcome.detail or outcome.violations}")
                ends.append(time.monotonic())

            runner.run([TestCase(log, seed=-1 - number) for number in range(2 * jobs)])
            runner.each([TestCase(log, seed=number) for number in range(trials + 2 * jobs)], ended)  # type: ignore[attr-defined]
            return trials / (ends[trials + jobs - 1] - ends[jobs - 1])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2, 4, 8], help="workers")
    parser.add_argument("--trials", type=int, default=20, help="trials of each worker")
    parser.add_argument("--rounds", type=int, default=1, help="measured so often, by turns; the best counts")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    found = {unit: dict.fromkeys(options.jobs, 0.0) for unit in UNITS}
    for _ in range(options.rounds):
        for unit, rates in found.items():
            for jobs in rates:
                rates[jobs] = max(rates[jobs], measure(unit, jobs, options.trials * jobs))
    if options.json:
        print(json.dumps(found))
        return
    for unit, rates in found.items():
        base = rates[options.jobs[0]] / options.jobs[0]
        for jobs, rate in rates.items():
            print(f"{unit:8} {jobs:2} workers: {rate:6.1f} trials/s, {rate / base / jobs:.2f} of linear")


if __name__ == "__main__":
    main()
