"""No broken log brings a traceback, a hang or unbounded memory; what can be read is read, and the rest is counted."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.log_mutants import mutants
from tests.tiers import ALL, PART, PARTS

ROOT = Path(__file__).parents[3]
PROCESSES = 64
LEAST = 200


def test_the_corpus_is_large_and_always_the_same():
    first = [(mutant.name, hash(mutant.data)) for mutant in mutants()]
    assert len(first) >= LEAST
    assert first == [(mutant.name, hash(mutant.data)) for mutant in mutants()]
    assert not [name for name, count in Counter(name for name, _ in first).items() if count > 1]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("part", range(PROCESSES) if ALL else range(PART // PARTS % 8, PROCESSES, 8))
def test_broken_logs(part, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "tests.log_actions", str(tmp_path), str(part), str(PROCESSES)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    last = outcomes[-1]["name"] if outcomes else "none"
    assert done.returncode == 0, f"ended behind {last!r}: {done.stderr[-2000:]}"
    assert len(outcomes) >= LEAST // PROCESSES
    wrong = {each["name"]: each["wrong"] for each in outcomes if "wrong" in each}
    assert not wrong, "\n".join(
        f"{name}: {action}: {text}" for name, found in wrong.items() for action, text in found.items()
    )
    for each in outcomes:
        check(each)


def check(outcome):
    """What is readable is read, what is missing is said, and all readers say the same."""
    name, read, info = outcome["name"], outcome["read"], outcome["info"]
    if "refused" in read:
        assert outcome["readable"] == 0, name
        assert "refused" in info, name
        return
    assert read["messages"] >= outcome["readable"], name
    if outcome["lossy"] is not None:
        assert read["lossy"] == outcome["lossy"], f"{name}: {read['loss']}"
        assert info["lossy"] == outcome["lossy"], name
    edited = outcome["edit"]
    assert edited["messages"] == read["messages"], name
    assert not edited["lossy"], f"{name}: {edited['loss']}"
    columns = outcome["columns"]
    if "rows" in columns and len(columns["rows"]) == 1 and outcome["lossy"] is False:
        assert sum(columns["rows"].values()) <= read["messages"], name
