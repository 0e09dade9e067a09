"""The demo over several seeds: every figure that docs/figures.md quotes, as a table and as JSON.

python benchmarks/demo.py [--seeds 5] [--first-seed 0] [--out DIR] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

RELEVANT = (
    "/goal:pose.position.x",
    "/goal:pose.position.y",
    "/odom:twist.twist.linear.x",
    "/odom:twist.twist.linear.y",
)
TRUTH = {"/goal:pose.position.x": (-100.0, 100.0), "/goal:pose.position.y": (-100.0, -80.0)}


def run(seed: int, out: Path) -> dict[str, object]:
    """Run one demo in a folder of its own."""
    command = [sys.executable, "-m", "riot_bus", "demo", "--seed", str(seed), "--out", str(out), "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200, check=False)
    (out / "narration.txt").write_text(done.stderr)
    if done.returncode:
        return {"seed": seed, "error": done.stderr[-2000:]}
    figures: dict[str, object] = json.loads(done.stdout)
    return figures


def row(one: dict) -> str:
    """Return one line of the table."""
    if "error" in one or not one.get("finding"):
        return f"{one['seed']:>4}  {one.get('error', 'no finding')}"
    region = one["region"] or {}
    sides = [(end, true) for name, ends in TRUTH.items() for end, true in zip(region.get(name, ()), ends, strict=False)]
    off = max((abs(end - true) for end, true in sides), default=float("nan"))
    wrong = [name for name in one["permeable_fields"] if name not in RELEVANT]
    missed = [name for name in RELEVANT if name not in one["permeable_fields"]]
    told = one["rule_balanced_accuracy"]
    accuracy = "not tested" if told is None else f"{told:.3f}"
    return (
        f"{one['seed']:>4} {one['seconds']:>6.0f} s {one['nominal_messages']:>6} -> {one['minimal_messages']}  "
        f"fields {len(one['relevant_fields'])}  accuracy {accuracy}  "
        f"runs {one['activation_runs']}  replays {one['activation_replay_rate']}  region off by {off:.1f} m  "
        f"permeable wrong {wrong} missed {missed}\n      {one['rule']}"
    )


def main() -> None:
    """Run all seeds and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    base = options.out or Path(tempfile.mkdtemp(prefix="riot-demo-"))
    results = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        results.append(run(seed, base / str(seed)))
        print(row(results[-1]), flush=True)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
