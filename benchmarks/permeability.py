"""Which external fields `riot permeability` names on the rover, of which the truth is known: real processes.

Usage: python benchmarks/permeability.py [--seeds N] [--first N] [--ways WAY ...] [--jobs N]

The rover's window of the map follows two fields of the goal and two of the odometry. The goal comes again and again
(`repeated`), once (`once`), or again and again while only the first one counts (`latched`); `logged` has no
external components, but the log of a nominal run. Each is the example with a line or two of its programs changed.

In runs with a constant goal, the other coordinate of the goal has an effect too: the rover drives at the same speed
whatever the direction, so how fast it moves along x also depends on y, and the simulator's odometry brings that to the
window. In 40 s it is a few tenths of a cell where the goal is too far to be reached. Naming it is right, not naming it
no mistake; it is counted as `loop`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.chain.steps.permeability import permeability
from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, FindingRecord

EXAMPLE = Path(__file__).resolve().parents[1] / "examples/rover"
INTERNAL = ("/map_updates:x", "/map_updates:y")
TRUE = {
    ("/goal:pose.position.x", "/map_updates:x"),
    ("/goal:pose.position.y", "/map_updates:y"),
    ("/odom:twist.twist.linear.x", "/map_updates:x"),
    ("/odom:twist.twist.linear.y", "/map_updates:y"),
}
LOOP = {("/goal:pose.position.x", "/map_updates:y"), ("/goal:pose.position.y", "/map_updates:x")}
CHOOSES, TAKES = "        if self._left == 0:\n", "        if on_site(goal.x, goal.y):\n            self._goal ="
CHANGES = {
    "once": ("rover/operator_.py", CHOOSES, "        if tick:\n            return\n" + CHOOSES),
    "latched": ("rover/mapper.py", TAKES, "        if self._goal is None:\n            self._goal ="),
}
WAYS = ("repeated", *CHANGES, "logged")


def rover(folder: Path, way: str, nominal: Path | None) -> Path:
    """Write the rover as it is in one of the ways; return its riot.toml."""
    shutil.copytree(EXAMPLE, folder, ignore=shutil.ignore_patterns("__pycache__", "riot-out"))
    system = folder / "riot.toml"
    if way in CHANGES:
        name, old, new = CHANGES[way]
        text = (folder / name).read_text()
        assert text.count(old) == 1, f"{name} has changed"
        (folder / name).write_text(text.replace(old, new))
    if nominal is not None:
        shutil.copy(nominal, folder / "nominal.mcap")
        text = system.read_text()
        begin, end = text.index("[components.sim]"), text.index("[components.mapper]")
        one = 'segments = ["inside"]\nnominal = "nominal.mcap"'
        system.write_text((text[:begin] + text[end:]).replace('segments = ["outside", "inside"]', one))
    return system


def finding(folder: Path, system: Path) -> Path:
    """Write a finding of the planner as far as the step needs one."""
    folder.mkdir(parents=True)
    FindingRecord(
        id=folder.name, system="rover", system_file=str(system), unit="planner", component="planner", monitor="crash",
        signature="crash in planner", messages=1, modified=1,
    ).save(folder)  # fmt: skip
    sure = CertificateRecord(
        failing=1, passing=0, failing_log="", passing_log="", confirmed_failing=3, confirmed_passing=3, repeats=3
    )
    fields = [
        FieldRecord(name=name, kind="exceptional", type="int32", failing=1, certificate=sure) for name in INTERNAL
    ]
    FieldsRecord(fields=tuple(fields), considered=INTERNAL, bound=0.05, straight=60).save(folder)
    return folder


def main() -> None:
    """Print a line of JSON for each seed, then how many are right in each way."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--ways", nargs="*", default=list(WAYS), choices=WAYS)
    parser.add_argument("--jobs", type=int, default=0, help="runs at once; 0: one per processor")
    options = parser.parse_args()
    right: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        with Workspace(rover(root / "recorded", "repeated", None), root / "out", seed=0) as workspace:
            nominal = workspace.nominal_log()
        for way in options.ways:
            system = rover(root / way, way, nominal if way == "logged" else None)
            for seed in range(options.first, options.first + options.seeds):
                begin = time.monotonic()
                with Workspace(system, root / f"out-{way}-{seed}", jobs=options.jobs, seed=seed) as workspace:
                    folder = finding(workspace.findings / "crash-planner-0", system)
                    record = permeability(StepRun(workspace, "permeability"), folder)
                named = {(edge.external, edge.internal) for edge in record.edges if edge.permeable}
                missed, false = TRUE - named, named - TRUE - (LOOP if way != "logged" else set())
                right[way] += not (missed or false)
                line = {"way": way, "seed": seed, "right": not (missed or false), "runs": record.runs}
                line |= {"loop": len(named & LOOP)}
                odd = {"missed": sorted(missed), "false": sorted(false)} if missed or false else {}
                print(json.dumps({**line, "s": round(time.monotonic() - begin, 1), **odd}), flush=True)
    for way in options.ways:
        print(f"{way}: {right[way]} of {options.seeds} name the true fields and no others", file=sys.stderr)


if __name__ == "__main__":
    main()
