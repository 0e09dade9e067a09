"""The judge, real faults of real software: `python -m benchmarks.real_faults check [NAME ...]`; see README.md."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.real_faults.case import Case, all_cases


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
    for name, about in {"check": "whether program and twin do what the truth says, without riot"}.items():
        command = commands.add_parser(name, help=about)
        command.add_argument("names", nargs="*", metavar="NAME")
        command.add_argument("--seed", type=int, default=0)
        command.add_argument("--draws", type=int, default=200)
    options = parser.parse_args()
    failed = 0
    for case in chosen(options.names):
        problems = check(case, draws=options.draws, seed=options.seed)
        failed += bool(problems)
        print(f"{case.name}: {'ok' if not problems else f'{len(problems)} problems'}", flush=True)
        for each in problems[:10]:
            print(f"    {each}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.exit(main())
