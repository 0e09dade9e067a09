"""Fuzzes a target with coverage: `python tests/fuzz/run.py TARGET [libFuzzer options, such as -max_total_time=600]`.

Needs Atheris (`pip install --group fuzz`; CPython on Linux x86_64). What it finds worth keeping is added to
tests/fuzz/corpus/TARGET, which the gate runs through the target; an input that fails is written to the working folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

with atheris.instrument_imports(include=["riot_bus", "riot_bus_mavlink", "riot_bus_ros2"]):
    from tests.fuzz.targets import TARGETS, seeds


def main() -> None:
    """Fuzz."""
    name, *options = sys.argv[1:]
    corpus = ROOT / "tests/fuzz/corpus" / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, data in enumerate(seeds(name)):
        (corpus / f"seed-{number}").write_bytes(data)
    atheris.Setup([sys.argv[0], *options, str(corpus)], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
