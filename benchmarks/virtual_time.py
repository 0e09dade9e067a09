"""The rover, driven by its nominal log, in virtual time: whether runs are the same, and how long they take.

`python benchmarks/virtual_time.py [--runs N] [--analyze] [--seed N] [--json]`: runs of planner, mapper and controller
at 25 times the speed of the log, in virtual time with fresh processes, and with processes that go on. Runs are the same
if all messages have the same time, key and payload. `--analyze` has `riot analyze` find the crash of the planner at
that speed and in virtual time instead, and tells what came of its activation.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.chain.base.external import driving_log
from riot_bus.chain.base.workspace import Workspace
from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.records import FindingRecord
from riot_bus.log.reader import read_log
from riot_bus.pool.local import Pool
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.trial import TestCase

ROVER = Path(__file__).resolve().parents[1] / "examples" / "rover"
PACES = (
    "perturbed_run = { duration = 40, speed = 8 }    # slower: what follows what is told by time\n"
    "trial_run = { duration = 6, speed = 25 }\n"
)
VIRTUAL = (
    "perturbed_run = { duration = 40 }\ntrial_run = { duration = 6 }\nclock = { reset = { topic = 'rover/reset' } }\n"
)
WAYS = ("timed", "virtual, fresh", "virtual")


def write_systems(folder: Path, seed: int) -> dict[str, Path]:
    """Write the rover's systems without its outside, of which there is a log; return the paths of their riot.toml."""
    shutil.copytree(ROVER, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    with Workspace(folder / "riot.toml", folder / "nominal", seed=seed) as workspace:
        shutil.copy(workspace.nominal_log(), folder / "nominal.mcap")
    text = (folder / "riot.toml").read_text()
    for name in ("sim", "operator"):
        begin = text.index(f"[components.{name}]")
        text = text[:begin] + text[text.index("[components.", begin + 1) :]
    timed = text.replace("nominal_run = ", 'nominal = "nominal.mcap"\nnominal_run = ')
    if PACES not in timed:
        raise SystemExit(f"the paces of {ROVER / 'riot.toml'} are no longer those that this replaces")
    virtual = timed.replace(PACES, VIRTUAL)
    texts = (timed, virtual.replace("{ reset = { topic = 'rover/reset' } }", "{}"), virtual)
    paths = {way: folder / f"{way.replace(', ', '-')}.toml" for way in WAYS}
    for path, each in zip(paths.values(), texts, strict=True):
        path.write_text(each)
    return paths


def compare_runs(folder: Path, systems: dict[str, Path], runs: int) -> dict[str, dict[str, object]]:
    """Return by way how many different runs there were, and how long one took."""
    found: dict[str, dict[str, object]] = {}
    for way, path in systems.items():
        with Workspace(path, folder / way) as workspace:
            pace = workspace.context.file.system.trial_run
            case = TestCase(driving_log(workspace, pace))
        plain = SystemTrial(
            pace, ("/cmd_vel:linear.x", "/plan:poses[0].pose.position.x", "/map_updates:x", "/map:info.width")
        )
        seen, seconds = set(), []
        with Pool(path, 1, keep=folder / "trials") as pool:
            for _ in range(runs):
                outcome = pool.execute(plain, case)
                seen.add(repr(sorted(outcome.observed.items())))
                seconds.append(outcome.seconds)
            logs = set()
            for number in range(min(runs, 10)):
                log = folder / f"{number}.mcap"
                pool.execute(SystemTrial(pace, record=True), case, into=log)
                logs.add(tuple((one.time, one.key, one.payload) for one in read_log(log)))
        found[way] = {
            "runs": runs,
            "different": len(seen),
            "different logs of 10": len(logs),
            "seconds": round(statistics.median(seconds), 3),
        }
    return found


def compare_chains(folder: Path, systems: dict[str, Path], seed: int) -> dict[str, dict[str, object]]:
    """Return by way what came of the activation of the planner's crash."""
    found: dict[str, dict[str, object]] = {}
    for way in ("timed", "virtual"):
        out = folder / f"out-{way}"
        command = [sys.executable, "-m", "riot_bus", "analyze", "--system", str(systems[way]), "--out", str(out)]
        subprocess.run([*command, "--seed", str(seed)], check=False, stdout=subprocess.DEVNULL)
        for finding in sorted((out / "findings").iterdir()):
            if ActivationRecord.exists(finding):
                record = ActivationRecord.load(finding)
                found[f"{way}: {FindingRecord.load(finding).signature}"] = {
                    "seconds": record.seconds,
                    "runs": record.runs,
                    "text": record.text,
                }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--analyze", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        systems = write_systems(folder, options.seed)
        found = (
            compare_chains(folder, systems, options.seed)
            if options.analyze
            else compare_runs(folder, systems, options.runs)
        )
    if options.json:
        print(json.dumps(found, indent=2))
        return
    for way, row in found.items():
        print(f"{way:16}", ", ".join(f"{name} {value}" for name, value in row.items()))


if __name__ == "__main__":
    main()
