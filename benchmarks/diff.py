"""What `riot diff` finds in long logs and how long it takes, and whether it calls nominal runs the same.

python benchmarks/diff.py [--count 100000] [--pairs 20] [--learn 3] [--system riot.toml] [--seed 0]
                          [--field TOPIC:PATH] [--out DIR] [--json]

First two logs of as many messages each, JSON and CDR, into which one difference was planted or that differ all over.
Then nominal runs of a system (the rover), as `riot test` records them: tolerances are proposed from the first ones, and
each two of all others are compared with them; into one of each two a message is changed, which has to be found.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from riot_bus.chain.base.workspace import Workspace
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes
from riot_bus_logtools.comparison.opening import compare_logs, propose_tolerances
from riot_bus_logtools.comparison.parts import TopicDifference
from riot_bus_logtools.comparison.tolerances import TopicTolerances
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions

ROOT = Path(__file__).resolve().parents[1]
TYPES = {"cmd_vel": "geometry_msgs/msg/TwistStamped"}
BEGIN, MS = 1_700_000_000 * 10**9, 10**6
Row = tuple[float, ...]
"""Time in the message, a number that grows, and a random one."""


def as_json(row: Row) -> bytes:
    return json.dumps({"stamp": row[0], "n": int(row[1]), "x": row[2], "mode": "auto"}).encode()


def as_cdr(row: Row) -> bytes:
    head = struct.pack("<iI", int(row[0]), int(row[0] % 1 * 1e9)) + struct.pack("<I", 5) + b"base\0"
    return b"\0\1\0\0" + head + bytes(-len(head) % 8) + struct.pack("<6d", row[1], row[2], 0.0, 0.0, 0.0, 0.5)


FORMS: dict[str, tuple[str, str, Callable[[Row], bytes]]] = {
    "json": ("robot/state", "application/json", as_json),
    "cdr": ("cmd_vel", "", as_cdr),
}


def rows(count: int, *, start: float = 0.0, noise: float = 0.0, seed: int = 0) -> list[Row]:
    values, noisy = random.Random(1), random.Random(seed)
    return [
        (start + n / 1000, float(n), values.gauss(0, 1) + (noisy.gauss(0, noise) if noise else 0)) for n in range(count)
    ]


def cases(count: int) -> Iterator[tuple[str, list[Row], list[Row], list[str], Callable[[TopicDifference], bool]]]:
    """Yield what differs, both logs, tolerances, and what has to be told."""
    base, at = rows(count), count // 2
    yield "nothing", base, base, [], lambda one: one.same
    other = [*base]
    other[at] = (base[at][0], base[at][1], base[at][2] + 0.5)
    yield "one field", base, other, [], lambda one: (one.changed, one.fields[0].example.a) == (1, at)
    yield "one is lost", base, base[:at] + base[at + 1 :], [], lambda one: (one.lost, one.lost_at) == (1, (at,))
    other = [*base]
    other[at : at + 2] = reversed(other[at : at + 2])
    yield "two are swapped", base, other, [], lambda one: (one.moved, one.changed, one.lost) == (1, 0, 0)
    yield "all stamps", base, rows(count, start=1e6), [], lambda one: one.same and len(one.left) > 0
    stamped = rows(count, start=1e6)
    yield "all stamps, one is lost", base, stamped[:at] + stamped[at + 1 :], [], lambda one: one.lost_at == (at,)
    noisy = rows(count, start=1e6, noise=1e-3, seed=2)
    tolerated = ["**:x=0.01", "**:twist.linear.y=0.01"]
    yield "all values, tolerated", base, noisy, tolerated, lambda one: one.same and one.near == count
    yield (
        "all values",
        base,
        noisy[:at] + noisy[at + 1 :],
        [],
        lambda one: (one.changed, one.lost_at) == (count - 1, (at,)),
    )


def write(path: Path, form: str, log: list[Row]) -> Path:
    key, encoding, payload = FORMS[form]
    path.unlink(missing_ok=True)
    with LogWriter(path, registry=TypeRegistry(load_adapters(), declared=TYPES)) as writer:
        for number, row in enumerate(log):
            writer.write(Message(BEGIN + number * MS, key, payload(row), encoding=encoding, sequence=number))
    return path


def long_logs(count: int) -> list[dict[str, Any]]:
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for form in FORMS:
            for name, before, after, tolerances, expected in cases(count):
                a, b = write(Path(folder, "a.mcap"), form, before), write(Path(folder, "b.mcap"), form, after)
                wishes = Wishes(tolerances=TopicTolerances.of_options(tolerances))
                begun, worked = time.perf_counter(), time.process_time()
                (topic,) = compare_logs(a, b, wishes).topics
                seconds, busy = time.perf_counter() - begun, time.process_time() - worked
                found.append(
                    {
                        "form": form,
                        "differs": name,
                        "found": expected(topic),
                        "seconds": round(seconds, 2),
                        "processor": round(busy, 2),
                    }
                )
    return found


def nominal_runs(system: Path, out: Path, count: int, seed: int) -> list[Path]:
    """Record nominal runs of a system, as far as they are not there."""
    logs = []
    for number in range(count):
        with Workspace(system, out / f"{number:02d}", jobs=1, seed=seed) as workspace:
            logs.append(workspace.nominal_log())
    return logs


def nominal_pairs(logs: list[Path], learn: int, field: str, out: Path) -> dict[str, Any]:
    proposal = propose_tolerances(logs[:learn])
    wishes = Wishes(tolerances=proposal.given())
    same = found = 0
    differing = []
    key, _, path = field.rpartition(":")
    rest = logs[learn:]
    for a, b in zip(rest[::2], rest[1::2], strict=True):
        told = compare_logs(a, b, wishes)
        same += told.same
        differing += [] if told.same else [[topic.topic for topic in told.topics if not topic.same]]
        changed = out / "changed.mcap"
        edit(EditOptions(inputs=[b], output=changed, force=True, changes=[f"{field} += 0.5 index 40"]))
        topics = {each.topic: each for each in compare_logs(a, changed, wishes).topics}
        found += [(one.name, one.messages) for one in topics[key].fields] == [(path, 1)]
    pairs = len(rest) // 2
    return {
        "learnt_from": learn,
        "tolerances": len(proposal.tolerances),
        "pairs": pairs,
        "same": same,
        "changed_field_found": found,
        "differing": differing,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--pairs", type=int, default=20, help="of nominal runs; 0 for none")
    parser.add_argument("--learn", type=int, default=3, help="runs that tolerances are proposed from")
    parser.add_argument("--system", type=Path, default=ROOT / "examples/rover/riot.toml")
    parser.add_argument("--seed", type=int, default=0, help="of the runs")
    parser.add_argument("--field", default="/goal:pose.position.x", help="field of which one value is changed")
    parser.add_argument("--out", type=Path, help="keep the runs there, and take those that are there")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results: dict[str, Any] = {"count": options.count, "long": long_logs(options.count) if options.count else []}
    if options.pairs:
        with tempfile.TemporaryDirectory() as folder:
            out = options.out or Path(folder)
            logs = nominal_runs(options.system, out, options.learn + 2 * options.pairs, options.seed)
            results["nominal"] = nominal_pairs(logs, options.learn, options.field, out)
    results["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    if options.json:
        print(json.dumps(results, indent=2))
        return
    print(f"{options.count} messages beside {options.count}; most memory {results['megabytes']} MB")
    for row in results["long"]:
        print(
            f"{row['form']:6}{row['differs']:28}{'found' if row['found'] else 'NOT FOUND':12}"
            f"{row['seconds']:>8.2f} s{row['processor']:>8.2f} s of a processor"
        )
    if "nominal" in results:
        one = results["nominal"]
        print(
            f"{one['same']} of {one['pairs']} pairs of nominal runs are the same with {one['tolerances']} tolerances "
            f"from {one['learnt_from']} other runs {one['differing'] or ''}; "
            f"a changed field is found in {one['changed_field_found']}"
        )


if __name__ == "__main__":
    main()
