"""What a Dask cluster loses: `python benchmarks/cluster.py [--trials N] [--kills N] [--seed N] [--json]`.

A campaign on a unit that fails and needs `sim = 1` is carried out on this machine, then by two Dask workers on
loopback, of which one is killed at random moments. Once the client (`riot test`) is killed, once the scheduler; the
same command goes on each time. Told is whether both campaigns have the same findings, and the same outcome of each
trial; what was lost or is there twice; which trials only one of them asked for: the last ones, which look for slow
growth, follow what memory the others took; and how often two units ran at once. Workers have folders for temporary
files of their own, so that what riot does on one machine to share resources is no help.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.campaign.store import TrialStore, stored_trials
from riot_bus.zenoh.session import wait_until
from tests.dask_cluster import DaskCluster
from tests.systems.misbehaviour.catalogue import write

if TYPE_CHECKING:
    from collections.abc import Sequence

UNIT = "raises"
ENVIRONMENT = 4
ALONE = """
import fcntl, pathlib
alone = (pathlib.Path(__file__).parent / "alone").open("a")
try:
    fcntl.flock(alone, fcntl.LOCK_EX | fcntl.LOCK_NB)
except OSError:
    with (pathlib.Path(__file__).parent / "exceeded").open("a") as told:
        told.write("x")
"""
"""Each unit holds a lock for as long as it lives, and tells if another one has it."""


def system_of(folder: Path) -> Path:
    """Write the system; return the path of riot.toml."""
    path = write(folder)
    head = f"[components.{UNIT}]\n"
    text = path.read_text().replace(head, f"{head}resources = {{ sim = 1 }}\n")
    path.write_text(f"{text}\n[resources]\nsim = 1\n")
    node = folder / "node.py"
    doc, _, rest = node.read_text().partition('"""\n\nimport ctypes')
    node.write_text(f'{doc}"""\n{ALONE}\nimport ctypes{rest}')
    return path


def command(path: Path, out: Path, trials: int, *more: str) -> subprocess.Popen[bytes]:
    """Start `riot test`."""
    arguments = ["test", f"--system={path}", f"--unit={UNIT}", f"--out={out}", f"--trials={trials}", *more]
    with (out.parent / f"{out.name}.log").open("ab") as log:
        return subprocess.Popen([sys.executable, "-m", "riot_bus", *arguments], stdout=log, stderr=log)


def stored(out: Path) -> list[dict[str, object]]:
    return stored_trials(out / "trials" / TrialStore.NAME)


def outcomes(out: Path) -> dict[str, tuple[object, object]]:
    return {str(row["key"]): (row["verdict"], row["signatures"]) for row in stored(out)}


def findings(out: Path) -> list[str]:
    return sorted(json.loads(path.read_text())["signature"] for path in out.glob("findings/*/finding.json"))


class Killer(threading.Thread):
    """Kills a worker when as many trials have ended as each number says, and a random moment later."""

    def __init__(self, cluster: DaskCluster, out: Path, at: Sequence[int], dice: random.Random) -> None:
        super().__init__(daemon=True)
        self.cluster, self.out, self.at, self.dice = cluster, out, at, dice
        self.killed = 0
        self.over = threading.Event()

    def run(self) -> None:
        """Kill at each number, until it is over."""
        for number in self.at:
            wait_until(lambda: self.over.is_set() or len(stored(self.out)) >= number, 3600)  # noqa: B023
            self.over.wait(self.dice.uniform(0.0, 0.5))
            while not self.over.is_set():
                if processes := self.cluster.worker_processes():
                    self.dice.choice(processes).kill()
                    self.killed += 1
                    break
                time.sleep(0.05)


def measure(folder: Path, trials: int, kills: int, seed: int) -> dict[str, Any]:
    """Return the figures of one run."""
    dice = random.Random(seed)
    path = system_of(folder)
    here, there = folder / "here", folder / "there"
    begun = time.monotonic()
    command(path, here, trials, "--jobs=2").wait()
    seconds = {"here": round(time.monotonic() - begun, 1)}
    ends: list[str] = []
    begun = time.monotonic()
    with DaskCluster(folder / "dask", 2) as cluster:
        options = (f"--executor={cluster.executor}",)
        killer = Killer(cluster, there, sorted(dice.sample(range(5, trials), kills)), dice)
        killer.start()
        client = command(path, there, trials, *options)
        wait_until(lambda: len(stored(there)) >= trials // 3 or client.poll() is not None, 3600)
        client.kill()
        ends.append(f"client killed after {len(stored(there))} trials: status {client.wait()}")
        client = command(path, there, trials, *options)
        wait_until(lambda: len(stored(there)) >= 2 * trials // 3 or client.poll() is not None, 3600)
        cluster.scheduler.kill()
        ends.append(f"scheduler killed after {len(stored(there))} trials: exit code {client.wait()}")
        cluster.kill()
        cluster.start()
        client = command(path, there, trials, *options)
        ends.append(f"exit code {client.wait()}")
        killer.over.set()
        killer.join()
    seconds["cluster"] = round(time.monotonic() - begun, 1)
    mine, theirs = outcomes(here), outcomes(there)
    campaign = json.loads((there / "campaign.json").read_text())
    exceeded = folder / "exceeded"
    return {
        "trials asked": trials,
        "trials of the campaign": campaign["trials"],
        "outcomes here": len(mine),
        "outcomes on the cluster": len(theirs),
        "rows that are there twice": len(stored(there)) - len(theirs),
        "lost": campaign["trials"] - len(theirs),
        "other than here": sum(theirs[key] != mine[key] for key in mine.keys() & theirs.keys()),
        "asked only here": len(mine.keys() - theirs.keys()),
        "asked only there": len(theirs.keys() - mine.keys()),
        "findings here": findings(here),
        "findings on the cluster": findings(there),
        "workers killed": killer.killed,
        "ends": ends,
        "two units at once": len(exceeded.read_text()) if exceeded.exists() else 0,
        "seconds": seconds,
        "load at the end": os.getloadavg()[0],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--keep", type=Path, help="folder for all that is written, instead of one that is removed")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory(prefix="riot-cluster-") as name:
        folder = options.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        found = measure(folder, options.trials, options.kills, options.seed)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        for key, value in found.items():
            print(f"{key:>26}  {value}")


if __name__ == "__main__":
    main()
