"""Tries whether the tests notice random one-line changes of the core: `bootstrap.py run python .ci/mutants.py`.

A condition is negated, a call whose result nobody takes is left out, or a number is larger by one. The tests that it
concerns run as in the gate of this commit, those of its room first; what these do not notice is tried at the end with
all of them, whatever their part. Changes are made in this checkout, which has to be clean, and taken back at once.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.changed import concerned  # noqa: E402
from tests.tiers import PART  # noqa: E402

WORKERS = {"pure": os.cpu_count() or 1, "processes": 6}


def mutants(text: str) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield what can be replaced in a module, within functions, and by what."""
    for function in ast.walk(ast.parse(text)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.If | ast.While | ast.IfExp):
                yield node.test, f"(not ({ast.unparse(node.test)}))"
            elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
                yield node, "pass"
            elif isinstance(node, ast.Constant) and type(node.value) is int:
                yield node, str(node.value + 1)


def one_line(text: str) -> list[tuple[ast.expr | ast.stmt, str]]:
    """Return the replacements that stay within a line; of nested functions, each only once."""
    found = {(node.lineno, node.col_offset, new): (node, new) for node, new in mutants(text)}
    return [(node, new) for node, new in found.values() if node.lineno == node.end_lineno]


def replaced(text: str, node: ast.expr | ast.stmt, new: str) -> str:
    """Return a text in which a node of one line is replaced; columns of syntax trees count bytes."""
    lines = text.encode().splitlines(keepends=True)
    line = lines[node.lineno - 1]
    lines[node.lineno - 1] = line[: node.col_offset] + new.encode() + line[node.end_col_offset :]
    return b"".join(lines).decode()


def noticed(words: list[str], **environment: str) -> str:
    """Return the first test that fails, or nothing."""
    for phase, workers in WORKERS.items():
        command = [sys.executable, "-m", "pytest", "-xq", f"--phase={phase}", f"-n{workers}", "--tb=no", *words]
        done = subprocess.run(
            command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, check=False
        )
        if done.returncode not in (0, 5):
            lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
            return " ".join((lines or [done.stdout[-200:] + done.stderr[-200:]])[0].split()[:2])
    return ""


@contextmanager
def mutated(path: Path, node: ast.expr | ast.stmt, new: str) -> Iterator[list[str]]:
    """Change a file for a while; give the tests that it concerns, those of its room first."""
    name, text = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
    room = path.relative_to(ROOT / "riot_bus").parts[0].removesuffix(".py")
    tests = sorted(concerned({name}), key=lambda each: (f"/{room}/" not in str(each), room not in each.name, each))
    print(f"{name}:{node.lineno}: {new}  in  {text.splitlines()[node.lineno - 1].strip()}")
    began = time.monotonic()
    try:
        path.write_text(replaced(text, node, new), encoding="utf-8")
        yield [str(each) for each in tests]
    finally:
        subprocess.run(["git", "checkout", "--quiet", "--", name], cwd=ROOT, check=True)
        print(f"    ({time.monotonic() - began:.0f} s)", flush=True)


def main() -> int:
    """Try the mutants and print lines for each; return 1 if the gate misses one that all tests notice."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if subprocess.run(["git", "diff", "--quiet"], cwd=ROOT, check=False).returncode:
        sys.exit("mutants.py: commit what has changed first: the file of a mutant is checked out anew")
    os.environ.pop("RIOT_PART", None)
    draw = random.Random(options.seed)
    files = sorted(path for path in (ROOT / "riot_bus").rglob("*.py"))
    places = [(path, node, new) for path in files for node, new in one_line(path.read_text(encoding="utf-8"))]
    left = []
    for mutant in draw.sample(places, options.count):
        with mutated(*mutant) as tests:
            by = noticed(tests, RIOT_PART=str(PART))
            print(f"    {by or 'not by the gate'}")
        left += [] if by else [mutant]
    print(f"the gate notices {options.count - len(left)} of {options.count}; the others with all tests:")
    missed = 0
    for mutant in left:
        with mutated(*mutant) as tests:
            by = noticed(tests)
            print(f"    {by or 'NOT NOTICED'}")
        missed += bool(by)
    print(f"{missed} of {options.count} are noticed by all tests, but not by the gate")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
