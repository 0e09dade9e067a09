"""Measures the branch coverage of all pure tests and shows it by room.

Fails if a room of the analysis, all of which is pure, is below the floor. What others do with processes and Zenoh is
tested by processes, which are not measured.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

from coverage import Coverage

ROOT = Path(__file__).resolve().parents[1]
ANALYSIS = ["backchain", "campaign", "chain", "findings", "generalize", "inject", "monitors", "pipeline", "statistics"]
FLOOR = 95.0
"""Least coverage of these rooms in percent; the floor that each of them has had for long."""


def main() -> int:
    """Run the tests and print the table; return 1 if a test fails or a room is below the floor."""
    phase = ["--phase=pure", f"-n{os.cpu_count()}", "--dist=worksteal"]
    command = [sys.executable, "-m", "pytest", *phase, "--cov", "--cov-branch", "--cov-report=", *sys.argv[1:]]
    failed = subprocess.run(command, cwd=ROOT, env={**os.environ, "RIOT_ALL_TESTS": "1"}, check=False).returncode
    coverage = Coverage(data_file=str(ROOT / ".coverage"), config_file=str(ROOT / "pyproject.toml"))
    coverage.load()
    places = [path for above in ("riot_bus", "adapters", "extensions") for path in sorted((ROOT / above).iterdir())]
    below = False
    for path in (each for each in places if each.is_dir() and list(each.rglob("*.py"))):
        share = coverage.report(include=[f"{path}/*"], file=io.StringIO())
        below |= path.name in ANALYSIS and share < FLOOR
        print(f"{share:6.1f} %  {path.relative_to(ROOT)}")
    return 1 if failed or below else 0


if __name__ == "__main__":
    sys.exit(main())
