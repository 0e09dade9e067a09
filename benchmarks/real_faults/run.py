"""Runs riot on cases as a user does, or on their truths, and the peers beside it."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.real_faults.case import Case
from benchmarks.real_faults.function import TruthRunner
from benchmarks.real_faults.grade import POINTS, Grade, grade
from benchmarks.real_faults.peers import PeerResult, run_peers
from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.analyze import analyze_all
from riot_bus.chain.steps.robustness import test_unit
from riot_bus.vocabulary.errors import RiotError

_BEYOND_S = 300.0  # `riot analyze --for` ends a step in time, but not at once
_TRIALS = 300  # what both commands try of a unit in two minutes


@dataclass(slots=True)
class Result:
    """One case: what `riot test` took, what riot found out, and what it found on the twin.

    Attributes:
        trials: Number of all trials, as far as the truth was asked.
        test_s: Duration of `riot test` in seconds, which each peer gets, too.
        seconds: Duration of `riot test` and `riot analyze` in seconds.
        load: Processes that wanted a processor over the last minute, at the end.
        error: What went wrong, if there is no grade.
    """

    name: str
    kind: str
    trials: int = 0
    test_s: float = 0.0
    seconds: float = 0.0
    load: float = 0.0
    grade: Grade | None = None
    twin: dict[str, int] = field(default_factory=dict)
    peers: dict[str, PeerResult] = field(default_factory=dict)
    error: str = ""


def run_case(
    case: Case,
    out: Path,
    *,
    seconds: float,
    seed: int,
    twin: bool = False,
    peers: bool = False,
    as_function: bool = False,
    explain: bool = True,
    points: int = POINTS,
) -> Result:
    """Run riot on a case, and grade what it says.

    Args:
        out: Folder that everything is written into; what is there is removed.
        seconds: Time for `riot analyze`, in seconds.
        twin: Whether to test the twin, too.
        peers: Whether to run the peers, each for as long as `riot test` took.
        as_function: Whether the truth stands in for the process.
        explain: Whether what was found is analysed, too; without, it is a campaign alone. Of functions only.
        points: Number of inputs on which rules are tried.
    """
    shutil.rmtree(out, ignore_errors=True)
    result, began = Result(case.name, case.file.kind), time.monotonic()
    try:
        if as_function:
            _as_function(case, out, result, seed=seed, explain=explain)
        else:
            case.write(out, case.command("{endpoint}"))
            _riot(out, 900.0, "test", f"--seed={seed}")
            result.test_s = time.monotonic() - began
            if any((out / "riot-out/findings").glob("*/finding.json")):
                _riot(out, seconds + _BEYOND_S, "analyze", f"--seed={seed}", f"--for={seconds:.0f}s")
            if twin and case.has_truth:
                case.write(out / "twin", case.command("{endpoint}", twin=True))
                _riot(out / "twin", 900.0, "test", f"--seed={seed}")
                found = grade(case, out / "twin/riot-out", twin=True).findings
                result.twin = dict(Counter(each.sort for each in found))
        result.seconds = time.monotonic() - began
        if peers and case.has_truth and not as_function:
            result.peers = run_peers(case, seconds=result.test_s, seed=seed)
        result.grade = grade(case, out / "riot-out", points=points)
    except (RiotError, RuntimeError, OSError, subprocess.TimeoutExpired) as error:
        result.error = str(error)[:300]
        result.seconds = time.monotonic() - began
    result.load = os.getloadavg()[0]
    return result


def _as_function(case: Case, out: Path, result: Result, *, seed: int, explain: bool) -> None:
    began = time.monotonic()
    truth = TruthRunner(case)
    with Workspace(case.write(out, ["true"]), out / "riot-out", seed=seed, runners=truth) as workspace:
        folders = test_unit(workspace, "node", trials=_TRIALS, seconds=None, covered=False)
        result.test_s = time.monotonic() - began
        if explain:
            analyze_all(workspace, folders)
    result.trials = truth.asked


def _riot(folder: Path, seconds: float, *words: str) -> None:
    """Run a command of riot in a folder; what it prints is kept there. Other ends than its verdicts are errors."""
    with (folder / f"{words[0]}.txt").open("w") as text:
        done = subprocess.run(
            [sys.executable, "-m", "riot_bus", *words],
            cwd=folder,
            stdout=text,
            stderr=text,
            timeout=seconds,
            check=False,
        )
    if done.returncode not in (0, 1, 5):
        last = (folder / f"{words[0]}.txt").read_text().strip().splitlines()[-1:]
        raise RuntimeError(f"riot {words[0]} ended with {done.returncode}: {' '.join(last)}")


def about(**options: Any) -> dict[str, Any]:
    """Return what results depend on beside the cases: commit, machine and options, and the date."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False).stdout
    return {
        "date": time.strftime("%Y-%m-%d"),
        "commit": commit.strip(),
        "python": platform.python_version(),
        "cpus": os.cpu_count(),
        **options,
    }
