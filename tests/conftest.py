"""Which items belong to which phase of the gate, and what a run says at its end of what it could not test."""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests import processor_time
from tests.changed import changed_files, concerned
from tests.tiers import ALL, PART, PARTS, of_other_parts, scaled

ROOT = Path(__file__).parent
PHASES = ("pure", "processes", "alone")
"""Unit and property tests; integration tests, several at once; those that want the machine for themselves."""

CONCERNED = pytest.StashKey[set[Path] | None]()
"""The test files that a change concerns, if only those are wanted."""

# What fails prints its example; the database would make one run depend on another.
# An example takes as long as the machine lets it, and so does drawing it.
settings.register_profile(
    "nightly", database=None, print_blob=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("gate", settings.get_profile("nightly"), max_examples=scaled(100))
settings.load_profile("nightly" if ALL else "gate")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let bootstrap.py run the suite in phases, or what a change concerns."""
    parser.addoption("--phase", choices=PHASES, help="run one phase only; bootstrap.py runs them in turn")
    parser.addoption(
        "--changed",
        nargs="?",
        const="",
        metavar="COMMIT",
        help="run what concerns the files that differ from COMMIT (that at which this branch has left main), all of it",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Look up what a change concerns."""
    base = config.getoption("--changed")
    config.stash[CONCERNED] = None if base is None else concerned(changed_files(base))


def pytest_report_header() -> str:
    """Say which part it is: what fails in it is tried again by setting it."""
    return "everything" if ALL else f"RIOT_PART={PART}: one of {PARTS} parts of what takes long"


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that no change concerns, and by their text those that have nothing for the phase."""
    if not collection_path.name.startswith("test_"):
        return None
    chosen = config.stash[CONCERNED]
    if chosen is not None and collection_path not in chosen:
        return True
    wanted = config.getoption("--phase")
    if wanted is None:
        return None
    text = collection_path.read_text(encoding="utf-8")
    if wanted == "pure":
        (whole,) = re.findall(r"^pytestmark = .*", text, re.MULTILINE) or ("",)
        return True if re.search(r"mark\.(integration|e2e|load)", whole) else None
    marks = r"mark\.integration" if wanted == "processes" else r"mark\.(e2e|load)"
    return None if re.search(marks, text) else True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what belongs to the phase and, unless everything or certain files are wanted, to the gate of this commit."""
    wanted = config.getoption("--phase")
    chosen = [item for item in items if wanted in (None, _phase(item))]
    if not ALL:
        named = config.stash[CONCERNED] is not None or config.args != config.getini("testpaths")
        whole = config.pluginmanager.has_plugin("tests.processor_time") or (named and "RIOT_PART" not in os.environ)
        others = set[str]() if whole else of_other_parts(processor_time.read())
        chosen = [item for item in chosen if not item.get_closest_marker("nightly") and item.nodeid not in others]
    if len(chosen) < len(items):
        kept = set(chosen)
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = chosen


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say loudly, once, which foreign programs were not there."""
    reasons: Counter[str] = Counter()
    for report in terminalreporter.stats.get("skipped", ()):
        text = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if "NOT TESTED: " in text:
            reasons[text.partition("NOT TESTED: ")[2]] += 1
    if reasons:
        terminalreporter.section("NOT TESTED", sep="!", red=True, bold=True)
        for reason, count in sorted(reasons.items()):
            terminalreporter.write_line(f"NOT TESTED: {reason} ({count} tests skipped)", red=True)


def _phase(item: pytest.Item) -> str:
    if item.get_closest_marker("e2e") or item.get_closest_marker("load"):
        return "alone"
    return "processes" if item.get_closest_marker("integration") else "pure"
