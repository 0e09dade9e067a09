"""The judge, real faults of real software: `python -m benchmarks.real_faults COMMAND`; see README.md."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from benchmarks.real_faults.case import Case, all_cases
from benchmarks.real_faults.page import PAGE, page, peers_table, summary, table
from benchmarks.real_faults.run import about, run_case


def chosen(names: list[str]) -> list[Case]:
    """Return the cases of these names, all if there are none; exits for a name that there is not."""
    cases = {case.name: case for case in all_cases()}
    if unknown := set(names) - cases.keys():
        sys.exit(f"no case {', '.join(sorted(unknown))}; there are {', '.join(cases)}")
    return [cases[name] for name in names or cases]


def check(case: Case, *, draws: int, seed: int) -> list[str]:
    """Return what is wrong with a case: its truth is not what program and twin do."""
    expected = [(False, case.nominal, "the nominal inputs")]
    if case.has_truth:
        expected += [(fails, list(log), f"edge {number}") for number, (fails, log) in enumerate(case.truth.edges(), 1)]
        drawn = list(case.draws(draws, seed)) if case.file.chance == 1 else []
        expected += [(case.fails(log), log, f"draw {number}") for number, log in enumerate(drawn, 1)]
    problems = [f"{name}: the truth says {not fails}" for fails, log, name in expected if case.fails(log) is not fails]
    if case.has_truth and {fails for fails, _, _ in expected} != {True, False}:
        problems.append("edges() has to yield inputs that fail and inputs that do not")
    failing = sum(fails for fails, _, name in expected if name.startswith("draw"))
    if case.has_truth and case.file.chance == 1 and not draws // 10 <= failing <= draws - draws // 10:
        problems.append(f"of {draws} drawn inputs {failing} fail: draw more near the limits")
    for twin in (False, True) if case.has_truth else (False,):
        for (fails, _, name), (shown, run) in zip(expected, case.shown(expected, twin=twin), strict=True):
            if shown is not (fails and not twin):
                what = f"{'the twin' if twin else 'the program'} {run.end} {run.error} {run.place}".strip()
                problems.append(f"{name}: {'failure' if shown else 'no failure'}, the truth says {fails}: {what}")
    return problems


def main() -> int:
    """Carry out the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    checking = commands.add_parser("check", help="whether program and twin do what the truth says, without riot")
    checking.add_argument("--draws", type=int, default=200)
    running = commands.add_parser("run", help="riot test and riot analyze, graded by the truth")
    running.add_argument("--seconds", type=float, default=120.0, help="for riot analyze")
    running.add_argument("--as-function", action="store_true", help="the truth stands in for the process")
    running.add_argument("--no-twin", action="store_true", help="leave the twin out")
    running.add_argument("--no-peers", action="store_true", help="leave out what people would use instead")
    running.add_argument("--out", type=Path, help="keep what riot writes there")
    running.add_argument("--json", type=Path, help="write all results there, and go on from those that it has")
    paging = commands.add_parser("page", help="write docs/real-software.md")
    paging.add_argument("json", type=Path, help="results of `run --json`")
    for each in (checking, running):
        each.add_argument("names", nargs="*", metavar="NAME")
        each.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    return {"check": _check, "run": _run, "page": _page}[options.command](options)


def _check(options: argparse.Namespace) -> int:
    failed = 0
    for case in chosen(options.names):
        problems = check(case, draws=options.draws, seed=options.seed)
        failed += bool(problems)
        print(f"{case.name}: {'ok' if not problems else f'{len(problems)} problems'}", flush=True)
        for each in problems[:10]:
            print(f"    {each}")
    return 1 if failed else 0


def _run(options: argparse.Namespace) -> int:
    how = {"seconds": options.seconds, "seed": options.seed, "as_function": options.as_function}
    more = {"twin": not options.no_twin, "peers": not options.no_peers}
    saved = {"about": about(**how, **more), "results": []}
    with tempfile.TemporaryDirectory(prefix="real-faults-") as folder:
        out = options.out or Path(folder)
        path = options.json or out / "results.json"
        if path.exists():
            kept = json.loads(path.read_text(encoding="utf-8"))
            if other := [
                key for key, value in saved["about"].items() if key != "date" and kept["about"].get(key) != value
            ]:
                sys.exit(f"{path} has results of another {', '.join(other)}; name another file, or remove it")
            saved = kept
        done = {one["name"] for one in saved["results"]}
        for case in chosen(options.names):
            if case.name in done:
                continue
            print(f"{case.name} ...", file=sys.stderr, flush=True)
            saved["results"].append(asdict(run_case(case, out / case.name, **how, **more)))
            new = path.with_suffix(".new")
            new.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
            new.replace(path)
    results = saved["results"]
    print(table(results), peers_table(results), " ".join(summary(results)), sep="\n\n")
    return 0


def _page(options: argparse.Namespace) -> int:
    saved = json.loads(options.json.read_text(encoding="utf-8"))
    PAGE.write_text(page(saved, all_cases()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.exit(main())
