"""The pytest plug-in: fixtures `riot`, `riot_router`, `riot_segment`, `riot_finding`, and the marker `riot`.

See docs/pytest.md for their use. Every pytest run loads this file if riot_bus is installed, so it imports the rest
of riot_bus only when a fixture is used.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from riot_bus.vocabulary.redaction import without_commands

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping, Sequence

    from riot_bus.chain.steps.reproduce import Reproduction
    from riot_bus.testing.fixture import RouterTest
    from riot_bus.testing.live_router import LiveRouter, LiveSegment

_MARKER = "riot(plan=None, segment=None, intercept=()): use the fixture riot with this injection plan (or several), in \
this segment, with these topics intercepted"
_OUTCOMES = pytest.StashKey[dict[str, str]]()
"""Outcome of each phase of the test, and whether its call has ended."""

_LOG = pytest.StashKey[Path]()
_USED = pytest.StashKey["RouterTest"]()
_LONGEST_NAME = 150  # file systems allow 255 bytes, and a hash and suffixes are added


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add our options."""
    group = parser.getgroup("riot", "robustness tests on a message bus (riot_bus)")
    group.addoption(
        "--riot-record",
        choices=("on-failure", "always", "never"),
        default="on-failure",
        help="keep the log (MCAP) of tests that use the fixture riot [default: on-failure]",
    )
    group.addoption("--riot-record-dir", type=Path, metavar="DIR", help="where [default: riot-logs in the root folder]")
    group.addoption("--riot-seed", type=int, default=0, metavar="N", help="seed of all that riot injects [default: 0]")
    told = "segments of the router; tests publish in the first, what they test is in the last"
    parser.addini("riot_segments", told, type="args", default=["system", "unit"])
    parser.addini("riot_types", "types of messages, TOPIC=TYPE a line", type="linelist", default=[])
    parser.addini("riot_messages", "files that define types of messages", type="paths", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Declare our marker."""
    config.addinivalue_line("markers", _MARKER)


def pytest_itemcollected(item: pytest.Item) -> None:
    """Make marked tests use the fixture before other function-scoped ones, which may start the program under test."""
    if not isinstance(item, pytest.Function) or item.get_closest_marker("riot") is None:
        return
    names, known = item.fixturenames, item._fixtureinfo.name2fixturedefs
    if "riot" not in names:
        shared = (number for number, name in enumerate(names) if name in known and known[name][-1].scope != "function")
        names.insert(max(shared, default=-1) + 1, "riot")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Delete the log of a test if no phase failed, unless all logs are kept or the run was interrupted."""
    result = yield
    log, outcomes = item.stash.get(_LOG, None), item.stash.get(_OUTCOMES, {})
    kept = item.config.getoption("--riot-record") == "always" or "failed" in outcomes.values()
    if log is not None and not kept:
        log.unlink(missing_ok=True)
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Note that the call has ended."""
    try:
        return (yield)
    finally:
        item.stash.get(_OUTCOMES, {})["ended"] = "yes"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add to a failed test's report its log, the command that repeats it, and what riot noticed."""
    report = yield
    outcomes = item.stash.setdefault(_OUTCOMES, {})
    outcomes[call.when] = report.outcome
    one, log = item.stash.get(_USED, None), item.stash.get(_LOG, None)
    if report.failed and one is not None:
        again = f"pytest {shlex.quote(str(item.config.rootpath / item.nodeid))} --riot-seed {one.seed}"
        told = {"log": str(log) if log is not None else "", "again": again}
        properties = [(f"riot-{name}", text) for name, text in told.items() if text]
        for each in (item, report):  # JUnit XML shows the properties of the last report, which are the item's
            each.user_properties += [one for one in properties if one not in each.user_properties]
        notes = one.unshown() if call.when == "call" and "ended" in outcomes else []
        lines = [
            *(f"note:  {text}" for text in notes),
            *(f"{f'{name}:':6} {text}" for name, text in told.items() if text),
        ]
        report.sections.append(("riot", without_commands("\n".join(lines))))
    return report


@pytest.fixture(scope="session")
def riot_router(request: pytest.FixtureRequest) -> Iterator[LiveRouter]:
    """A router on free ports for all tests of this process."""
    from riot_bus.config.arguments import parse_types
    from riot_bus.testing.live_router import LiveRouter
    from riot_bus.types.registry import TypeRegistry, load_adapters

    config = request.config
    registry = TypeRegistry(
        load_adapters(), declared=parse_types(config.getini("riot_types")), definitions=config.getini("riot_messages")
    )
    with LiveRouter(config.getini("riot_segments"), registry=registry) as router:
        yield router


@pytest.fixture(scope="session")
def riot_segment(riot_router: LiveRouter) -> Callable[[str], LiveSegment]:
    """Function from a segment's name to its endpoint, configuration file and environment variables."""
    return riot_router.segment


@pytest.fixture
def riot(request: pytest.FixtureRequest, riot_router: LiveRouter) -> Iterator[RouterTest]:
    """What a test intercepts, injects and sees; the test fails if something that it asked for did not happen."""
    from riot_bus.log.run import run_facts
    from riot_bus.log.writer import LogSettings, LogWriter
    from riot_bus.testing.fixture import router_test

    item, config = request.node, request.config
    item.stash[_OUTCOMES] = {}
    wanted = _marked(item)
    segment = riot_router.segment(wanted["segment"]) if wanted["segment"] else riot_router.inner
    seed, out = config.getoption("--riot-seed"), _folder_of(item)
    log = None
    if config.getoption("--riot-record") != "never":
        path = out.with_name(f"{out.name}.mcap")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise pytest.UsageError(f"--riot-record-dir {path.parent}: {error.strerror}") from None
        facts = {**run_facts(), "test": item.nodeid, "seed": str(seed)}
        log = LogWriter(path, LogSettings(threaded=True), registry=riot_router.registry, metadata=facts)
        item.stash[_LOG] = path
    types, definitions = config.getini("riot_types"), config.getini("riot_messages")
    place: dict[str, Any] = {"folder": request.path.parent, "out": out}
    with (
        router_test(riot_router, **place, seed=seed, log=log, types=types, definitions=definitions) as one,
        _environment(segment.variables),
    ):
        item.stash[_USED] = one
        if wanted["intercept"]:
            one.intercept(*wanted["intercept"])
        if wanted["plan"]:
            one.inject(*wanted["plan"])
        yield one
        problems = one.problems()
        if problems and item.stash[_OUTCOMES].get("call") == "passed":  # a failed call reports them itself
            pytest.fail(without_commands("riot: " + "\n".join(problems)), pytrace=False)


@pytest.fixture
def riot_finding(request: pytest.FixtureRequest) -> Callable[..., Reproduction]:
    """A finding's folder as a regression test: fails as long as fresh trials of its shortest log do."""

    def finding(path: str | Path, *, system: str | Path | None = None, trials: int | None = None) -> Reproduction:
        from riot_bus.testing.regression import reproduce_finding

        __tracebackhide__ = True
        folder, near = request.path.parent / path, request.path.parent / (system or "riot.toml")
        named = near if system is not None or near.is_file() else None
        found = reproduce_finding(folder, system=named, root=request.config.rootpath, trials=trials)
        assert found.answer == "fixed", without_commands(
            f"{found.failed} of {found.trials} trials of {found.log} fail: {found.detail}; "
            f"again: riot reproduce {shlex.quote(str(folder))}"
        )
        return found

    return finding


def _marked(item: pytest.Item) -> dict[str, Any]:
    """Return what the markers ask for: the segment that the closest one names, and the plans and topics of all."""
    plans: list[Any] = []
    topics: list[str] = []
    segment: str | None = None
    for marker in item.iter_markers("riot"):
        if marker.args or marker.kwargs.keys() - {"plan", "segment", "intercept"}:
            raise pytest.UsageError(f"{item.nodeid}: {_MARKER.partition(':')[0]} is what the marker riot takes")
        plans += _several(marker.kwargs.get("plan"))
        topics += _several(marker.kwargs.get("intercept"))
        segment = segment or marker.kwargs.get("segment")
    return {"plan": plans, "segment": segment, "intercept": topics}


def _several(given: Any) -> Sequence[Any]:
    if given is None:
        return ()
    return given if isinstance(given, list | tuple) else [given]


def _folder_of(item: pytest.Item) -> Path:
    """Return the path of a test's files: its name, as far as file systems allow, and a hash of it."""
    folder = item.config.getoption("--riot-record-dir") or item.config.rootpath / "riot-logs"
    name = re.sub(r"[^A-Za-z0-9_.\-]+", "_", item.nodeid).strip("_.")[-_LONGEST_NAME:]
    return Path(folder) / f"{name}-{hashlib.sha256(item.nodeid.encode()).hexdigest()[:6]}"


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
