"""Shows the branch coverage of each room that the tests have measured, and fails if one is below the floor.

The floor of pyproject.toml, `[tool.coverage.report] fail_under`, is one of each room by itself.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from coverage import Coverage
from coverage.exceptions import NoDataError, NoSource

ROOT = Path(__file__).resolve().parents[1] / "riot_bus"


def main() -> int:
    """Print a table; return 1 if a room is below the floor."""
    coverage = Coverage(config_file=str(ROOT.parent / "pyproject.toml"))
    floor = float(coverage.get_option("report:fail_under") or 0)
    try:
        coverage.load()
        found, whole = _by_room(coverage)
    except (NoDataError, NoSource) as error:
        print(f"coverage: {error}", file=sys.stderr)
        return 1 if floor else 0
    print("\nbranch coverage by room")
    below = []
    for room in sorted(str(each).rpartition(".")[2] for each in coverage.get_option("run:source_pkgs")):
        share = 100.0 * found[room] / whole[room] if whole[room] else 0.0  # of a room that no test has imported
        print(f"  {room:<12} {share:5.1f} %  of {whole[room]} statements and branches")
        if share < floor:
            below.append(room)
    if below:
        print(f"below {floor:g} %: {', '.join(below)}", file=sys.stderr)
    return 1 if below else 0


def _by_room(coverage: Coverage) -> tuple[Counter[str], Counter[str]]:
    found: Counter[str] = Counter()
    whole: Counter[str] = Counter()
    for name in coverage.get_data().measured_files():
        room = Path(name).relative_to(ROOT).parts[0]
        numbers = coverage._analyze(name).numbers
        found[room] += numbers.n_executed + numbers.n_executed_branches
        whole[room] += numbers.n_statements + numbers.n_branches
    return found, whole


if __name__ == "__main__":
    sys.exit(main())
