"""Uniform random runs of the whole rover beside activations: how often each makes the planner crash. Real processes.

Usage: python benchmarks/fuzzing.py [--uniform N] [--activations N] [--findings N] [--jobs N] [--json FILE]

A uniform run sets every external field of the rover, not only those that permeability leaves, to one value drawn
uniformly from the range that `riot activate` may search: +-5,000 m for the goal, others as riot derives them. An
activation is the search of that step, with its 200 runs, until the first that fails, which the step goes on to confirm,
simplify and replay. Activations have a seed each, but share the nominal run, rule and permeable fields of some demos
(`--findings`), and begin with a search along single fields that draws nothing: those of one demo are much alike. A run
is one `trial_run` of riot.toml in both, and counts if it fails with the finding's signature. No two runs have the same
seed, so the store of trials answers none, but for the runs of a batch that was killed.

One more uniform run for each activation, with its failing values among the random ones, checks that such runs would
show the crash. After a kill, the same command goes on from FILE and the folder beside it.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from riot_bus.backchain.activation import activate
from riot_bus.chain.base.external import ExternalField, external_fields
from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.chain.steps.robustness import test_unit, tested
from riot_bus.chain.whole.driven_system import DrivenSystem
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.steps import MINIMIZE, PERMEABILITY, RELEVANCE, RULES
from riot_bus.statistics.rates import exact_interval
from riot_bus.vocabulary.errors import InconclusiveError

EXAMPLE = Path(__file__).resolve().parents[1] / "examples/rover"
SEGMENTS = 'segments = ["outside", "inside"]\n'
TRIALS = 60  # of the unit's campaign, as in `riot demo`
BATCH = 20
SEED_OF_ACTIVATION, SEED_OF_UNIFORM, SEED_OF_CHECK = 1000, 1_000_000, 2_000_000


class Tally(BaseModel):
    """Uniform runs so far; `reached` counts those in which the planner got an update of the map."""

    runs: int = 0
    failed: int = 0
    reached: int = 0
    others: dict[str, int] = {}
    seconds: float = 0.0


class Search(BaseModel):
    """An activation; `first` is the number of its first failing run, and one or two of `runs` come before these."""

    seed: int
    first: int | None = None
    runs: int = 0
    fields: list[str] = []
    found: dict[str, float] | None = None
    others: dict[str, int] = {}
    seconds: float = 0.0


class Results(BaseModel):
    """All that is kept in the file."""

    preparation: dict[int, float] = {}
    fields: dict[str, tuple[float, float]] = {}
    activations: list[Search] = []
    uniform: Tally = Tally()
    check: Tally = Tally()


def prepare(out: Path, seed: int, jobs: int) -> Path:
    """Take the rover from a nominal run to the permeable fields, as `riot demo` does; return the finding."""
    with Workspace(EXAMPLE / "riot.toml", out, jobs=jobs, seed=seed) as workspace:
        workspace.nominal_log()
    shutil.copytree(EXAMPLE, out / "rover", ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
    text = (EXAMPLE / "riot.toml").read_text()
    assert text.count(SEGMENTS) == 1, "riot.toml has changed"
    (out / "rover/riot.toml").write_text(text.replace(SEGMENTS, f'{SEGMENTS}nominal = "../nominal.mcap"\n'))
    with Workspace(out / "rover/riot.toml", out, jobs=jobs, seed=seed) as workspace, suppress(InconclusiveError):
        unit = workspace.context.file.choose_unit(None)
        found = tested(workspace, unit) or test_unit(workspace, unit, trials=TRIALS, seconds=None, covered=False)
        for step in (MINIMIZE, RELEVANCE, RULES, PERMEABILITY):
            if not step.kind.exists(found[0]):
                workspace.carry_out(step, found[0])
    return found[0]


def search(workspace: Workspace, folder: Path) -> Search:
    """Search as the step `activate` does, until the first run that fails."""
    if not PermeabilityRecord.exists(folder):  # an earlier step was inconclusive
        return Search(seed=workspace.seed)
    begin, permeable = time.monotonic(), PermeabilityRecord.load(folder)
    system = DrivenSystem(StepRun(workspace, "activate"), folder, ())
    names = system.only_reached(permeable.permeable)
    result = activate(
        [system.fields[name].search_field() for name in names],
        lambda points: system.run(points, "search"),
        seed=workspace.seed,
        parallelism=system.runner.parallelism,
        families=system.varied.families,
        promising=permeable.failing,
    )
    return Search(
        seed=workspace.seed,
        first=next((number for number, (_, one) in enumerate(result.history, 1) if one.failed), None),
        runs=system.runner.executed,
        fields=names,
        found=None if result.found is None else dict(result.found),
        others=dict(system.others),
        seconds=round(time.monotonic() - begin, 2),
    )


def drawn(fields: Sequence[ExternalField], seed: int) -> dict[str, float]:
    """Draw a value of each field; whole numbers are rounded later."""
    rng = np.random.default_rng(seed)
    ends = ((one.name, one.search_field().ends if one.search_field().few else one.range) for one in fields)
    return {name: float(rng.uniform(low, high)) for name, (low, high) in ends}


def fuzz(
    workspace: Workspace, folder: Path, tally: Tally, puts: Sequence[Mapping[str, float]], save: Callable[[], None]
) -> dict[str, tuple[float, float]]:
    """Make a uniform run for each of `puts`, whose values replace random ones; return the fields and their ranges."""
    fields = [one for one in external_fields(workspace) if not one.alone]
    first, before = workspace.seed - tally.runs, Counter(tally.others)
    system = DrivenSystem(StepRun(workspace, "fuzz"), folder, (), names=[one.name for one in fields])
    while tally.runs < len(puts):
        begin, numbers = time.monotonic(), range(tally.runs, min(tally.runs + BATCH, len(puts)))
        found = system.run([drawn(fields, first + one) | dict(puts[one]) for one in numbers], "search")
        tally.runs = numbers.stop
        tally.failed += sum(one.failed for one in found)
        tally.reached += sum(one.distance is not None for one in found)
        tally.others = dict(before + system.others)
        tally.seconds += time.monotonic() - begin
        save()
        print(f"{tally.runs} of {len(puts)} uniform runs: {tally}", file=sys.stderr, flush=True)
    return {one.name: one.range for one in fields}


def rate(hits: int, total: int) -> str:
    """Return hits of a total with the exact interval of their rate."""
    low, high = exact_interval(hits, total)
    return f"{hits} of {total} (95 %: {low:.2%} to {high:.2%})"


def show(results: Results) -> None:
    """Print the results."""
    topics = Counter(name.partition(":")[0] for name in results.fields)
    print(f"{len(results.fields)} fields at random: " + ", ".join(f"{topics[one]} of {one}" for one in topics))
    for what, one in (("uniform runs", results.uniform), ("with the values of an activation", results.check)):
        print(f"{what}: {rate(one.failed, one.runs)} crash the planner; other failures {one.others};")
        each = f"{one.seconds / max(1, one.runs):.2f} s per run, {one.seconds:.0f} s in all"
        print(f"  {one.reached} with an update of the map; {each}")
    rows = results.activations
    firsts = sorted(row.first for row in rows if row.first is not None)
    runs, seconds = sum(row.runs for row in rows), sum(row.seconds for row in rows)
    others = sum((Counter(row.others) for row in rows), Counter[str]())
    print(f"activations: {rate(len(firsts), len(rows))} crash the planner; other failures {dict(others)};")
    if firsts:
        print(f"  the first failing run is number {statistics.median(firsts):g} ({firsts[0]} to {firsts[-1]});")
    print(f"  {runs} runs, {seconds / max(1, runs):.2f} s per run, {seconds:.0f} s in all")
    print(f"  after {len(results.preparation)} demos up to there, {sum(results.preparation.values()):.0f} s in all")


def main() -> None:
    """Run everything that the file does not have yet, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--uniform", type=int, default=2000)
    parser.add_argument("--activations", type=int, default=50)
    parser.add_argument("--findings", type=int, default=10, help="demos that activations share in turn")
    parser.add_argument("--jobs", type=int, default=0, help="runs at once; 0: as `riot activate` decides")
    parser.add_argument("--json", type=Path, default=Path("fuzzing.json"))
    options = parser.parse_args()
    file = options.json
    results = Results.model_validate_json(file.read_text()) if file.exists() else Results()

    def save() -> None:
        partial = file.with_suffix(".partial")
        partial.write_text(results.model_dump_json(indent=1) + "\n")
        partial.replace(file)

    def opened(folder: Path, seed: int) -> Workspace:
        out = folder.parents[1]
        return Workspace(out / "rover/riot.toml", out, jobs=options.jobs, seed=seed)

    folders: list[Path] = []
    for seed in range(max(1, min(options.findings, options.activations))):
        begin = time.monotonic()
        folders.append(prepare(file.with_suffix("") / str(seed), seed, options.jobs))
        results.preparation.setdefault(seed, round(time.monotonic() - begin, 1))
        save()
        print(f"demo {seed}: {results.preparation[seed]} s", file=sys.stderr, flush=True)
    for number in range(len(results.activations), options.activations):
        folder = folders[number % len(folders)]
        with opened(folder, SEED_OF_ACTIVATION * (1 + number)) as workspace:
            results.activations.append(search(workspace, folder))
        save()
        print(f"activation {number}: {results.activations[-1]}", file=sys.stderr, flush=True)
    with opened(folders[0], SEED_OF_UNIFORM + results.uniform.runs) as workspace:
        results.fields = fuzz(workspace, folders[0], results.uniform, [{}] * options.uniform, save)
    puts = [row.found for row in results.activations if row.found and row.found.keys() <= results.fields.keys()]
    with opened(folders[0], SEED_OF_CHECK + results.check.runs) as workspace:
        fuzz(workspace, folders[0], results.check, puts, save)
    save()
    show(results)


if __name__ == "__main__":
    main()
