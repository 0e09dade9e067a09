"""What each tuned number and each strategy is worth on the real faults, whose truths answer in place of processes.

python -m benchmarks.ablation FILE.json [--rows TEXT ...] [--seeds N] [--cases NAME ...] [--list]

A row is one change of the source: a number of a module halved or doubled, or a strategy off. Each runs in a process of
its own, in which the module is compiled with that change; the tree stays as it is. All rows have the same cases and
seeds, so a difference is one of the row. FILE.json keeps what was measured, and the same command goes on from there.
Numbers that nothing reads in any case are found first, and left out: no value of theirs can change anything.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

from pydantic import BaseModel

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "riot_bus"
ROOMS = ("campaign", "generalize", "backchain", "chain", "trial", "pool", "processes", "inject", "monitors")
FACTORS = (0.5, 2.0)
POINTS = 500  # a tenth of those of a result: rules that differ in less are not told apart here
FEATURES = {
    **{kind: (kind,) for kind in ("abs", "mul", "sub", "add", "div", "hypot", "maxabs", "minabs", "len", "bytes")},
    **{kind: (kind,) for kind in ("nan", "nonfinite", "ascii", "printable", "digits", "utf8")},
    "triples": ("mul3", "mulsub", "linear"),
}
_SEARCH = "generalize/rules.py:_Search"
OFF = {
    "two at once, in a row, elsewhere": ("campaign/covering.py:Covering._vary", "return None"),
    "what passed, again": ("campaign/covering.py:Covering.further", "return ()"),
    "many messages": ("campaign/covering.py:Covering.policies", "return ()"),
    "faults of messages": ("campaign/schedule.py:message_faults", "return []"),
    "malformed payloads": ("campaign/malformed.py:malformations", "return []"),
    "mutations": ("campaign/groups.py:groups_of", "return {}"),
    "values of the log": ("campaign/targets.py:with_observed", "return args[0]"),
    "plainer cases": ("campaign/triage.py:plainer", "return iter(())"),
    **{
        f"feature {name}": (
            "generalize/features.py:features_of",
            f"return [one for one in usual(*args) if one.kind not in {kinds}]",
        )
        for name, kinds in FEATURES.items()
    },
    "feature wraps": ("generalize/features.py:_wraps", "return []"),
    "feature casts": (f"{_SEARCH}.casts", "return False"),
    "feature prefix, contains": ("generalize/table.py:_beginnings", "return []"),
    "literals mod, bits": ("generalize/table.py:_residues", "return None"),
    "literals of sets": ("generalize/table.py:Table._categories", "return None"),
    "linear features of edges": (f"{_SEARCH}.lines", "return False"),
    "guards": ("generalize/beam.py:learn_guarded", "return args[3]"),
    "limits within a literal": ("generalize/rules.py:_doubtful", "return False"),
    "asking the committee": (f"{_SEARCH}._committee", "return []"),
    "asking at thresholds": (f"{_SEARCH}._thresholds", "return []"),
    "asking with other signs": (f"{_SEARCH}._mirrored", "return []"),
    "asking members of sets": (f"{_SEARCH}._members", "return []"),
    "deciding between rules": (f"{_SEARCH}.decide", "return False"),
    "terms improved together": ("generalize/beam.py:_improve", "return args[0]"),
    "simplest values": ("chain/unit/simplify.py:Simplification.run", "return kwargs['noise']"),
}
"""Strategies, each with the function that has it, and what that returns when it is off; `usual` is the function."""


class Row(BaseModel, frozen=True):
    """A change: the file within riot_bus, the name of a number or a function, and a factor or a body."""

    file: str = ""
    name: str = ""
    factor: float | None = None
    body: str = ""
    what: str = ""

    def __str__(self) -> str:
        if not self.file:
            return "as it is"
        return f"{self.what} off" if self.factor is None else f"{self.file}:{self.name} x {self.factor:g}"


def rows() -> Iterator[Row]:
    """Yield all rows: first no change."""
    yield Row()
    for what, (place, body) in OFF.items():
        file, _, name = place.partition(":")
        yield Row(file=file, name=name, body=body, what=what)
    for room in ROOMS:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            for name, value in numbers(ast.parse(path.read_text(encoding="utf-8"))):
                values = [each for each in _constants(value) if type(each) in (int, float) and each]
                shares = bool(values) and all(type(each) is float and each <= 1 for each in values)
                file = str(path.relative_to(PACKAGE))
                for factor in (*FACTORS, 0.0) if shares else FACTORS if values else ():
                    yield Row(file=file, name=name, factor=factor)


def numbers(module: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield the names in capitals that a module assigns numbers to, and their values."""
    for node in module.body:
        pairs: list[tuple[ast.expr, ast.expr | None]] = []
        if isinstance(node, ast.Assign):
            pairs = [(each, node.value) for each in node.targets]
        elif isinstance(node, ast.AnnAssign):
            pairs = [(node.target, node.value)]
        if len(pairs) == 1 and isinstance(pairs[0][0], ast.Tuple) and isinstance(pairs[0][1], ast.Tuple):
            pairs = list(zip(pairs[0][0].elts, pairs[0][1].elts, strict=True))
        for target, value in pairs:
            if isinstance(target, ast.Name) and target.id.strip("_").isupper() and value is not None:
                yield target.id, value


def _constants(value: ast.expr) -> Iterator[Any]:
    allowed = (ast.Constant, ast.Tuple, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.Load)
    if all(isinstance(node, allowed) for node in ast.walk(value)):
        yield from (node.value for node in ast.walk(value) if isinstance(node, ast.Constant))


def changed(text: str, row: Row) -> ast.Module:
    """Return a module with the change of a row; what stays has its lines, which some of riot looks up."""
    module = ast.parse(text)
    if row.body:
        *outer, name = row.name.split(".")
        body = module.body
        for each in outer:
            body = next(node.body for node in body if isinstance(node, ast.ClassDef) and node.name == each)
        place = next(at for at, node in enumerate(body) if isinstance(node, ast.FunctionDef) and node.name == name)
        other = ast.parse(f"def {name}(*args, usual={name}, **kwargs):\n    {row.body}").body[0]
        body.insert(place + 1, other)
        return ast.fix_missing_locations(module)
    value = next(value for name, value in numbers(module) if name == row.name)
    call = f"__import__('benchmarks.ablation', fromlist=['scaled']).scaled({ast.unparse(value)}, {row.factor})"
    new = ast.parse(call, mode="eval").body
    for node in ast.walk(module):
        for field, child in ast.iter_fields(node):
            if child is value:
                setattr(node, field, new)
            elif isinstance(child, list) and value in child:
                child[child.index(value)] = new
    return ast.fix_missing_locations(module)


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or each of some, times a factor: integers stay integers and not 0, shares stay at most 1."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(1, round(value * factor)) if value > 0 else min(-1, round(value * factor))
    return min(1.0, value * factor) if 0 < value <= 1 else value * factor


class Reading(ast.NodeTransformer):
    """Lets `names`, wherever a file reads them, be told to a function in `builtins`; private ones with their file."""

    def __init__(self, names: set[str], file: str) -> None:
        self._names, self._file = names, file

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Wrap a name that is read."""
        if node.id not in self._names or not isinstance(node.ctx, ast.Load):
            return node
        name = _told(self._file, node.id)
        return ast.Call(ast.Name("__reads__", ast.Load()), [ast.Constant(name), node], [])


def _told(file: str, name: str) -> str:
    return f"{file}:{name}" if name.startswith("_") else name


def compiled_anew(change: Callable[[Path], ast.Module | None]) -> None:
    """Compile what is imported from now on as `change` says, if it does."""
    usual = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, name: str) -> CodeType | None:
        module = change(Path(self.path)) if self.path.startswith(f"{PACKAGE}{os.sep}") else None
        return usual(self, name) if module is None else compile(module, self.path, "exec")

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign, assignment]


def use(row: Row) -> None:
    """Compile the module of a row with its change when it is imported in this process."""
    compiled_anew(lambda path: changed(path.read_text(encoding="utf-8"), row) if path == PACKAGE / row.file else None)


def note_reads(names: set[str]) -> set[str]:
    """Return a set that grows by each of these names that something reads, in modules imported from now on."""
    seen = set[str]()

    def reads(name: str, value: Any) -> Any:
        seen.add(name)
        return value

    def change(path: Path) -> ast.Module:
        module: ast.Module = Reading(names, str(path.relative_to(PACKAGE))).visit(
            ast.parse(path.read_text(encoding="utf-8"))
        )
        return ast.fix_missing_locations(module)

    builtins.__reads__ = reads  # type: ignore[attr-defined]
    compiled_anew(change)
    return seen


def work(
    row: Row | None, seeds: int, names: Sequence[str], *, without: Sequence[str] = (), explain: bool = True
) -> Any:
    """Return what each case and seed came to with the change of a row; without a row, which numbers were read.

    Strategies of `without` are off in any case.
    """
    read = note_reads({each.name for each in rows() if each.factor is not None}) if row is None else set()
    for each in (*(one for one in rows() if one.what in without), *([row] if row and row.file else [])):
        use(each)
    from benchmarks.real_faults.case import all_cases
    from benchmarks.real_faults.grade import GOOD
    from benchmarks.real_faults.run import run_case

    found = {}
    for case in all_cases():
        if not case.has_truth or (names and case.name not in names):
            continue
        for seed in range(seeds):
            began = time.process_time()
            with tempfile.TemporaryDirectory() as folder:
                result = run_case(
                    case, Path(folder), seconds=0, seed=seed, as_function=True, explain=explain, points=POINTS
                )
            grade = result.grade
            best = max((one.accuracy or 0.0 for one in grade.findings), default=0.0) if grade else 0.0
            found[f"{case.name} {seed}"] = {
                "met": float(grade is not None and grade.met),
                "explained": float(best >= GOOD),
                "accuracy": best,
                "wrong": float(sum(len(one.wrong) for one in grade.findings) + len(grade.wrong)) if grade else 0.0,
                "failed": float(grade is None),
                "trials": float(result.trials),
                "seconds": time.process_time() - began,
            }
    return found if row else sorted(read)


def table(measured: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return what each row changes, in Markdown: sums over all cases and seeds, and in how many anything differs."""
    usual = measured[str(Row())]
    lines = [
        "| row | differs | met | explained | accuracy | wrong | failed | trials | time |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in measured.items():
        common = usual.keys() & row.keys()
        sums = {
            key: (sum(row[one][key] for one in common), sum(usual[one][key] for one in common))
            for key in next(iter(usual.values()))
        }
        differs = sum({**row[one], "seconds": 0} != {**usual[one], "seconds": 0} for one in common)
        counts = [f"{mine:.6g} ({mine - theirs:+.3g})" for mine, theirs in list(sums.values())[:5]]
        ratios = [f"{mine / max(theirs, 1e-9):.2f}" for mine, theirs in list(sums.values())[5:]]
        lines.append(f"| {name} | {differs} of {len(common)} | {' | '.join([*counts, *ratios])} |")
    return "\n".join(lines)


def main() -> None:
    """Carry out the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--rows", nargs="*", default=[""], metavar="TEXT", help="only rows that contain one of these")
    parser.add_argument("--cases", nargs="*", default=[])
    parser.add_argument("--without", nargs="*", default=[], choices=OFF, help="strategies that are off in all rows")
    parser.add_argument("--campaigns", action="store_true", help="campaigns alone: what they meet")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--most-seconds", type=float, default=7200.0, help="for a row")
    parser.add_argument("--list", action="store_true", help="name the rows, and measure nothing")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        row = Row.model_validate_json(options.worker) if options.worker != "read" else None
        print(
            json.dumps(work(row, options.seeds, options.cases, without=options.without, explain=not options.campaigns))
        )
        return
    asked = [row for row in rows() if not row.file or any(text in str(row) for text in options.rows)]
    if options.list:
        print(*asked, sep="\n")
        return
    kept = json.loads(options.file.read_text()) if options.file.exists() else {"read": None, "rows": {}}

    def measure(row: Row | None) -> None:
        words = ["--worker", row.model_dump_json() if row else "read", "--cases", *options.cases]
        words += ["--without", *options.without, *["--campaigns"] * options.campaigns]
        command = [sys.executable, "-m", "benchmarks.ablation", str(options.file), f"--seeds={options.seeds}", *words]
        try:
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=options.most_seconds
            )
        except subprocess.SubprocessError as error:
            print(f"{row}: {error} {str(getattr(error, 'stderr', '') or '')[-200:]}", file=sys.stderr, flush=True)
            return
        found = json.loads(done.stdout.splitlines()[-1])
        with writing:
            if row is None:
                kept["read"] = found
            else:
                kept["rows"][str(row)] = found
            new = options.file.with_suffix(".new")
            new.write_text(json.dumps(kept))
            new.replace(options.file)

    writing = threading.Lock()
    if kept["read"] is None:
        measure(None)
    if kept["read"] is None:
        sys.exit("ablation.py: what is read was not found out; see the error above")
    unread = [row for row in asked if row.factor is not None and _told(row.file, row.name) not in kept["read"]]
    left = [row for row in asked if row not in unread and str(row) not in kept["rows"]]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, _ in enumerate(pool.map(measure, left), 1):
            print(f"{number} of {len(left)}", file=sys.stderr, flush=True)
    print(table(kept["rows"]))
    print("\nread in no case:", *sorted({f"{row.file}:{row.name}" for row in unread}), sep="\n- ")


if __name__ == "__main__":
    main()
