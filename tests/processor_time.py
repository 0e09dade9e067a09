"""Measures the processor time of tests; the gate rotates those that need much.

    python3 bootstrap.py test -p tests.processor_time

takes all that would rotate and writes `processor_time.json`: for each test function that needs more than LONG, the
seconds that one item of it takes on average, with the processes that it starts and waits for.
"""

from __future__ import annotations

import json
import resource
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from statistics import fmean

import pytest

FILE = Path(__file__).with_suffix(".json")

LONG = 0.15
"""Seconds of an item: what needs less is cheap enough for each commit."""

BEGAN = pytest.StashKey[float]()
NEEDED: defaultdict[str, list[float]] = defaultdict(list)


def function(nodeid: str) -> str:
    """Return the id of an item's function: what precedes its parameters."""
    return nodeid.partition("[")[0]


def spent() -> float:
    """Return the processor time of this process and of those that it has waited for, in seconds."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin with the first fixture."""
    item.stash[BEGAN] = spent()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """End with the last fixture; reports get from workers to where the file is written."""
    report = yield
    if call.when == "teardown":
        report.user_properties.append(("processor time", spent() - item.stash[BEGAN]))
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect what an item has needed."""
    if report.when == "teardown":
        (seconds,) = (value for name, value in report.user_properties if name == "processor time")
        NEEDED[function(report.nodeid)].append(float(str(seconds)))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write what is long; of functions that were not run, what has been known stays as long as they have a file."""
    if hasattr(session.config, "workerinput"):
        return
    known = {name: seconds for name, seconds in read().items() if (FILE.parents[1] / name.partition("::")[0]).exists()}
    means = known | {name: round(fmean(each), 2) for name, each in NEEDED.items()}
    long = {name: means[name] for name in sorted(means) if means[name] > LONG}
    FILE.write_text(json.dumps(long, indent=0) + "\n", encoding="utf-8")


def read() -> dict[str, float]:
    """Return the seconds of an item of each test function that needs much."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
