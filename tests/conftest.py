"""Which items belong to which phase of the gate, and what a run says at its end of what it could not test."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from coverage import Coverage
from hypothesis import HealthCheck, settings

from tests.tiers import ALL, scaled

ROOT = Path(__file__).parent
PHASES = ("pure", "processes", "alone")
"""Unit and property tests; integration tests, several at once; those that want the machine for themselves."""

# What fails prints its example; the database would make one run depend on another.
# An example takes as long as the machine lets it, and so does drawing it.
settings.register_profile(
    "nightly", database=None, print_blob=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("gate", settings.get_profile("nightly"), max_examples=scaled(100))
settings.load_profile("nightly" if ALL else "gate")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let bootstrap.py run the suite in phases."""
    parser.addoption("--phase", choices=PHASES, help="run one phase only; bootstrap.py runs them in turn")


def pytest_configure(config: pytest.Config) -> None:
    """End the first coverage of a worker of xdist: pytest-cov starts a second, and below it the first would go on."""
    first = Coverage.current()
    if first is not None and hasattr(config, "workerinput"):
        first.stop()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that have nothing for the phase by their text, which is much faster than importing them."""
    wanted = config.getoption("--phase")
    if wanted is None or not collection_path.name.startswith("test_"):
        return None
    text = collection_path.read_text(encoding="utf-8")
    if wanted == "pure":
        (whole,) = re.findall(r"^pytestmark = .*", text, re.MULTILINE) or ("",)
        return True if re.search(r"mark\.(integration|e2e|load)", whole) else None
    marks = r"mark\.integration" if wanted == "processes" else r"mark\.(e2e|load)"
    return None if re.search(marks, text) else True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what belongs to the phase, and to the gate unless everything is wanted."""
    wanted = config.getoption("--phase")
    chosen = [item for item in items if (ALL or _in_gate(item)) and wanted in (None, _phase(item))]
    if len(chosen) < len(items):
        config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
        items[:] = chosen


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Measure coverage while tests of a measured room run, and only then: it makes each test take twice as long.

    Long ones that reach nothing else are left out, too, by pytest-cov's mark `no_cover`.
    """
    coverage = Coverage.current()
    if coverage is None or _room(item.path) in _measured(coverage):
        return (yield)
    coverage.stop()
    try:
        return (yield)
    finally:
        coverage.start()


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


def _room(path: Path) -> str:
    """Return the room that a test file is about: tests/unit/ROOM/..., tests/property/test_ROOM.py."""
    kind, name, *_ = path.relative_to(ROOT).parts
    return name if kind == "unit" else name.removeprefix("test_").removesuffix(".py")


def _measured(coverage: Coverage) -> list[str]:
    return [name.rpartition(".")[2] for name in coverage.get_option("run:source_pkgs") or ()]


def _in_gate(item: pytest.Item) -> bool:
    return item.get_closest_marker("nightly") is None


def _phase(item: pytest.Item) -> str:
    if item.get_closest_marker("e2e") or item.get_closest_marker("load"):
        return "alone"
    return "processes" if item.get_closest_marker("integration") else "pure"
