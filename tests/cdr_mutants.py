"""Damaged CDR payloads of all types of a distribution, given to everything that a type can do.

`python -m tests.cdr_mutants [--mutants 100000] [--seed 0] [--json]` tries them all. Nothing but `PayloadError` may come
out. Memory is limited to what the first messages needed and 256 MiB more, so that anything unbounded ends in an error.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from riot_bus.types.bulk import gather
from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore
from tests.ros2_messages import NAMES, STORE, encode, random_document

MEMORY = 256 << 20
COUNTS = (0, 1, 2, 3, 255, 1 << 16, (1 << 24) + 1, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)
_LINE = "\n" + "=" * 80 + "\nMSG: pkg/"
HOSTILE = {
    "huge arrays": (
        f"uint8[99999999999999999999] a\nInner[4000000000] b\nstring[4000000000] c\nfloat32 d{_LINE}Inner\nuint8[] x\n"
    ),
    "empty messages": f"Inner[] a\nInner[1000000] b\nstring c{_LINE}Inner\n",
    "nothing": f"Inner[] a\nInner[1000000] b\nstring c{_LINE}Inner\nuint8[0] x\n",
    "wide": "".join(f"T{i} a\nT{i} b\nstring[3] s{_LINE}T{i}\n" for i in range(40)) + "uint8 z\n",
    "itself": "string a\nHostile[] b\nuint8 c\n",
    "wstring": "string a\nwstring[] b\nwstring<=5 c\nuint8 d\n",
    "nested sequences": f"A[] a{_LINE}A\nB[] a{_LINE}B\nC[] a{_LINE}C\nstring[] a\nfloat64[] b\n",
}


def kinds() -> dict[str, tuple[CdrType, bytes]]:
    """Return types and a payload of each to begin with."""
    rng = random.Random(0)
    found = {}
    for name in NAMES:
        found[name] = (CdrType(name, STORE), encode(name, random_document(name, rng, longest=3)))
    for name, text in HOSTILE.items():
        store = TypeStore(parse_msg(text, "pkg/msg/Hostile"))
        found[f"hostile: {name}"] = (CdrType("pkg/msg/Hostile", store), b"\0\1\0\0" + bytes(200))
    return found


def mutants(payload: bytes, rng: random.Random) -> Iterator[bytes]:
    """Yield damaged payloads, without end."""
    while True:
        data = bytearray(payload)
        for _ in range(rng.choice((1, 1, 2, 5))):
            fate = rng.randrange(7)
            at = rng.randrange(len(data) + 1)
            if fate == 0:
                del data[at:]
            elif fate == 1 and data:
                data[min(at, len(data) - 1)] ^= 1 << rng.randrange(8)
            elif fate == 2:
                at = 4 * (at // 4)
                data[at : at + 4] = struct.pack(rng.choice("<>") + "I", rng.choice(COUNTS))
            elif fate == 3:
                data[at:at] = rng.randbytes(rng.randrange(1, 20))
            elif fate == 4:
                del data[at : at + rng.randrange(1, 9)]
            elif fate == 5:
                data[:2] = rng.choice((b"\0\0", b"\0\1", b"\0\0", b"\0\3", b"\0\7", b"\0\x0b", b"\xff\xff"))
            else:
                data[4:] = rng.randbytes(rng.randrange(len(payload) + 1))
        yield bytes(data)


def acts(
    kind: CdrType, paths: list[str], payload: bytes, rng: random.Random
) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield what can be done with a payload."""
    yield "leaves", lambda: kind.leaves(payload, elements=rng.choice((0, 1, 16, 1 << 40)))
    yield "opaque", lambda: kind.opaque(payload)
    for path in rng.sample(paths, min(len(paths), 3)):
        value = rng.choice((0, -1, 3, 1 << 70, 1.5, float("nan"), float("inf"), "", "longer than it was", b"x", True))
        length = rng.choice((0, 1, 5, 100, (1 << 32) - 1, 1 << 32, -1))
        value = length if path.startswith("len(") else value
        yield f"read {path}", lambda path=path: kind.read(payload, path)
        yield f"patch {path}={value!r}", lambda path=path, value=value: kind.patch(payload, {path: value})
        yield f"rebuild {path}={value!r}", lambda path=path, value=value: kind.rebuild(payload, {path: value})
        yield f"gather {path}", lambda path=path: gather(kind, many(payload), path)
        yield f"patcher {path}", lambda path=path, value=value: patched(kind, payload, path, value)
        if path.startswith("len("):
            yield f"elements {path}", lambda path=path: list(kind.elements(many(payload), path[4:-1]))


def many(payload: bytes) -> Payloads:
    """Return the payload twice, with something between."""
    places = np.array([1, len(payload) + 4], np.int64)
    return Payloads(b"x" + payload + b"xyz" + payload, places, np.array([len(payload)] * 2, np.int64))


def patched(kind: CdrType, payload: bytes, path: str, value: Any) -> bytes | None:
    patcher = kind.patcher(path, value)
    return None if patcher is None else patcher(payload)


def run(count: int, seed: int) -> dict[str, Any]:
    """Try so many mutants; returns what was found."""
    everything = kinds()
    names = list(everything)
    found = Counter[str]()
    failures: list[str] = []
    slowest = (0.0, "")
    done = 0
    begun = time.perf_counter()
    limited = False
    for round_ in range(-(-count // (len(names) * 10))):
        for name in names:
            kind, payload = everything[name]
            rng = random.Random(f"{seed} {round_} {name}")
            try:
                paths = [field.path.replace("[*]", f"[{rng.randrange(3)}]") for field in kind.fields()]
            except PayloadError:
                paths = ["a", "b[0]", "len(b)", "c", "d"]
            source = mutants(payload, rng)
            for _ in range(10):
                mutant = next(source)
                done += 1
                for what, act in acts(kind, paths, mutant, rng):
                    start = time.perf_counter()
                    try:
                        act()
                        found["taken"] += 1
                    except PayloadError:
                        found["refused"] += 1
                    except Exception:
                        failures.append(f"{name}: {what}: {mutant.hex()}: {traceback.format_exc(limit=-3)}")
                    slowest = max(slowest, (time.perf_counter() - start, f"{name}: {what}"))
        if not limited:
            limited = True  # by now everything that is made once has been made
            limit_memory()
        if len(failures) > 20:
            break
    return {
        "mutants": done,
        "types": len(names),
        "acts": dict(found),
        "failures": failures[:20],
        "slowest_s": round(slowest[0], 3),
        "slowest": slowest[1],
        "peak_rss_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10,
        "seconds": round(time.perf_counter() - begun, 1),
    }


def limit_memory() -> None:
    """Let this process have no more than `MEMORY` in addition."""
    status = Path("/proc/self/status")
    if status.exists():
        size = next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmSize"))
        resource.setrlimit(resource.RLIMIT_AS, ((int(size) << 10) + MEMORY,) * 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--mutants", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found = run(args.mutants, args.seed)
    if args.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:14}{value}")
    sys.exit(bool(found["failures"]))


if __name__ == "__main__":
    main()
