"""Measures the processor time of tests; the gate of a commit takes a part of those that need much.

    python3 bootstrap.py test -p tests.processor_time

takes all of them and writes `processor_time.json`: the seconds of each item that needs more than LONG, with the
processes that it starts and waits for.
"""

from __future__ import annotations

import json
import resource
from collections.abc import Generator
from pathlib import Path

import pytest

FILE = Path(__file__).with_suffix(".json")

LONG = 0.05
"""Seconds of an item: what needs less is cheap enough for each commit."""

BEGAN = pytest.StashKey[float]()
NEEDED: dict[str, float] = {}


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
        NEEDED[report.nodeid] = float(str(seconds))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write what is long; of items that were not run, what has been known stays as long as they have a file."""
    if hasattr(session.config, "workerinput"):
        return
    known = {name: seconds for name, seconds in read().items() if (FILE.parents[1] / name.partition("::")[0]).exists()}
    all_of_them = sorted((known | NEEDED).items())
    long = {name: round(seconds, 2) for name, seconds in all_of_them if seconds > LONG}
    FILE.write_text(json.dumps(long, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")


def read() -> dict[str, float]:
    """Return the seconds of each item that needs much."""
    known: dict[str, float] = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    return known
