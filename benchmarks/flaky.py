"""The whole chain on a unit that crashes with probability p, beside its twin that always crashes, and a function.

Run `python benchmarks/flaky.py [--seeds N] [--p 0.3] [--json FILE]`. The unit is the pump of tests/systems, which reads
one field of JSON; `riot analyze` takes it from the nominal run to the crash of the whole system. A rule is right if it
is the one in the code, the stated rate if its 95 % interval contains p. All trials count, also those of the campaign.
The steps that explain are then asked of the same unit as a pure function, to compare trials.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from riot_bus.chain.base.workspace import Workspace
from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, RuleRecord
from riot_bus.findings.steps import MINIMIZE, RELEVANCE, RULES
from riot_bus.inject.apply import inject_log
from riot_bus.statistics.rates import exact_interval
from riot_bus.trial.baseline import UNKNOWN, Baseline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

PUMP = Path(__file__).resolve().parents[1] / "tests/systems/pump"
RULE = "pump/command:level > 100"
JOBS = 2  # the function is asked as many questions at once: several that are asked at once are more in all


@dataclass
class Function:
    """The pump as a pure function: gives runners to the steps that explain, and is one."""

    p: float
    violation: Violation
    chance: random.Random
    parallelism: int = JOBS

    def unit(self, _unit: str, _log: Callable[[], Sequence[Message]]) -> Function:
        """Return itself: a process that goes on is no other function."""
        return self

    def baseline(self, _unit: str, _log: Callable[[], Sequence[Message]]) -> Baseline:
        """Return that nothing is known."""
        return UNKNOWN

    def close(self) -> None:
        """Do nothing."""

    def run(self, cases: Sequence[TestCase]) -> list[Outcome]:
        """Answer each case."""
        return [self.play(case) for case in cases]

    def play(self, case: TestCase) -> Outcome:
        """Crash with probability p on each level above 100."""
        messages, touched = inject_log(case.messages, case.injections, registry=TypeRegistry(), seed=case.seed)
        for number, message in enumerate(messages):
            try:
                said = json.loads(message.payload)
            except ValueError:
                continue
            level = said.get("level") if isinstance(said, dict) else None
            numeric = isinstance(level, int | float) and not isinstance(level, bool)
            if numeric and level > 100 and self.chance.random() < self.p:
                modified = sum(index <= number for index, _, _ in touched)
                statistics = {"played": number + 1, "modified": modified}
                return Outcome(Verdict.FAIL, (self.violation,), statistics=statistics)
        return Outcome(Verdict.PASS)


def as_function(folder: Path, finding: Path, p: float, seed: int) -> dict[str, int]:
    """Return the trials that each step takes, from the same failing log on, if a function answers."""
    out = folder / "as-function"
    copied = out / "findings" / finding.name
    copied.mkdir(parents=True)
    for name in ("finding.json", "failure.mcap"):
        shutil.copy(finding / name, copied)
    shutil.copy(folder / "riot-out/nominal.mcap", out)
    found = FindingRecord.load(copied)
    answers = Function(p, Violation(found.monitor, found.component, found.signature), random.Random(seed))
    with Workspace(folder / "riot.toml", out, seed=seed, runners=answers) as workspace:  # type: ignore[arg-type]
        return {step.name: workspace.carry_out(step, copied).trials for step in (MINIMIZE, RELEVANCE, RULES)}


def run(folder: Path, p: float, seed: int) -> dict[str, object]:
    """Run the chain once; return what it found and what it took."""
    shutil.copytree(PUMP, folder, ignore=shutil.ignore_patterns("riot-out"))
    system = folder / "riot.toml"
    system.write_text(system.read_text().replace("FAULT", f"crash:{p}"))
    command = [sys.executable, "-m", "riot_bus", "analyze", "--seed", str(seed), "--jobs", str(JOBS)]
    command += ["--format", "json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=1800, check=False)
    (folder / "narration.txt").write_text(done.stderr)
    row: dict[str, object] = {"p": p, "seed": seed}
    findings = json.loads(done.stdout)["findings"] if done.stdout else []
    if len(findings) != 1:
        return row | {"error": f"{len(findings)} findings, status {done.returncode}: {done.stderr[-500:]}"}
    finding = folder / findings[0]["finding"]
    minimal, rule = MinimalRecord.load(finding), RuleRecord.load(finding)
    low, high = exact_interval(*minimal.failed)
    activation = ActivationRecord.load(finding) if ActivationRecord.exists(finding) else None
    steps = [one.load(finding) for one in (FieldsRecord, PermeabilityRecord, ActivationRecord) if one.exists(finding)]
    tested = json.loads((folder / "riot-out/campaign.json").read_text())["trials"]
    trials = [tested, minimal.trials, rule.trials, *(one.trials for one in steps)]
    return row | {
        "rule": rule.text,
        "right": rule.text == RULE,
        "rate": f"{low:.2f} to {high:.2f}",
        "rate_holds": low <= p <= high,
        "activated": activation is not None and bool(activation.found),
        "trials": sum(trials),
        "explained": {"minimize": minimal.trials, "relevance": FieldsRecord.load(finding).trials, "rules": rule.trials},
        "as function": as_function(folder, finding, p, seed),
    }


def main() -> None:
    """Run all seeds and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--p", type=float, default=0.3)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(prefix="riot-flaky-") as base:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            for p in (options.p, 1.0):
                try:
                    rows.append(run(Path(base) / f"{p}-{seed}", p, seed))
                except Exception as error:
                    rows.append({"p": p, "seed": seed, "error": repr(error)})
                print(rows[-1], flush=True)
    for p in (options.p, 1.0):
        ones = [row for row in rows if row["p"] == p and "error" not in row]
        told = {name: sum(bool(row[name]) for row in ones) for name in ("right", "rate_holds", "activated")}
        median = statistics.median([int(str(row["trials"])) for row in ones]) if ones else float("nan")
        print(f"p = {p}: of {options.seeds}: {told}; trials: median {median:.0f}")
        for step in ("minimize", "relevance", "rules") if ones else ():
            sides = [statistics.median(row[who][step] for row in ones) for who in ("explained", "as function")]  # type: ignore[index]
            print(f"  {step}: median {sides[0]:.0f} trials of processes, {sides[1]:.0f} of the function")
    ratios = [
        int(str(flaky["trials"])) / int(str(twin["trials"]))
        for flaky, twin in zip(rows[::2], rows[1::2], strict=True)
        if "error" not in flaky and "error" not in twin
    ]
    print("trials beside the twin's:", ", ".join(f"{one:.1f}" for one in ratios))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
