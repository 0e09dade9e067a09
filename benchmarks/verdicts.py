"""Whether campaigns name each planted fault rightly, and find nothing in robust units: real processes on a real bus.

Run `python benchmarks/verdicts.py [--campaigns N] [--trials N] [--robust N] [--busy N] [--seed N] [--kinds NAME ...]`.
The units are those of tests/systems/misbehaviour. A campaign is right if the signatures of its findings are exactly
the planted ones; robust units get `--robust` trials in one campaign each. `--busy` keeps so many processes computing
beside them, as a loaded machine would.
"""

from __future__ import annotations

import argparse
import json
import logging
import multiprocessing
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.findings.records import CampaignRecord, FindingRecord
from tests.systems.misbehaviour.catalogue import FAULTY, ROBUST, build, missing, write


def compute() -> None:
    """Keep a processor busy until the parent ends this process."""
    while True:
        sum(range(10_000))


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep so many processes computing."""
    others = [multiprocessing.Process(target=compute, daemon=True) for _ in range(count)]
    for each in others:
        each.start()
    try:
        yield
    finally:
        for each in others:
            each.kill()


def campaign(kind: str, *, trials: int, seed: int) -> tuple[list[str], CampaignRecord]:
    """Return the signatures that a campaign finds, sorted, and its record."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(folder, kind)
        with Workspace(write(folder, [kind]), folder / "out", jobs=2, seed=seed) as workspace:
            found = run_campaign(workspace, kind, trials=trials, seconds=None, covered=False)
            signatures = sorted(FindingRecord.load(each).signature for each in found)
        return signatures, CampaignRecord.load(folder / "out")


def expected(kind: str) -> list[str]:
    """Return the signatures that a campaign on a kind must find, sorted."""
    wanted = FAULTY.get(kind, ())
    return sorted(each.format(kind) for each in ((wanted,) if isinstance(wanted, str) else wanted))


def main() -> None:
    """Measure and print a line of JSON for each campaign, then what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--campaigns", type=int, default=5, help="of each planted fault, of different seeds")
    parser.add_argument("--trials", type=int, default=100, help="budget of a campaign on a planted fault")
    parser.add_argument("--robust", type=int, default=500, help="budget of the campaign on a robust unit")
    parser.add_argument("--busy", type=int, default=0, help="processes that compute beside the campaigns")
    parser.add_argument("--seed", type=int, default=0, help="of the first campaign")
    parser.add_argument("--kinds", nargs="*", default=[*FAULTY, *ROBUST], help="units; all by default")
    options = parser.parse_args()
    logging.getLogger("riot_bus").setLevel(logging.ERROR)
    right: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    with busy(options.busy):
        for kind in options.kinds:
            if lacking := missing(kind):
                print(f"{kind}: not tried: there is no {lacking}", file=sys.stderr)
                continue
            robust = kind in ROBUST
            for seed in range(options.seed, options.seed + (1 if robust else options.campaigns)):
                begin = time.monotonic()
                found, record = campaign(kind, trials=options.robust if robust else options.trials, seed=seed)
                tried[kind] += 1
                right[kind] += found == expected(kind)
                line = {"kind": kind, "seed": seed, "right": found == expected(kind), "trials": record.tested}
                told = {} if line["right"] else {"found": found}
                unsure = {"unconfirmed": len(record.unconfirmed)} if record.unconfirmed else {}
                print(json.dumps({**line, "s": round(time.monotonic() - begin, 1), **told, **unsure}), flush=True)
    print(f"{sum(right.values())} of {sum(tried.values())} campaigns are right")
    for kind, count in tried.items():
        if right[kind] < count:
            print(f"  {kind}: {right[kind]} of {count}")


if __name__ == "__main__":
    main()
