"""`riot ros-test`: runs a command with a router for its processes, and reports what passed through the router."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.control.log_paths import claim, file_stem
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import settings_of
from riot_bus.control.signals import END_S, ended_by_signals
from riot_bus.processes.launcher import Launcher
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh.session import environment_of_others
from riot_bus_bridges.ros_test.passage import Passage
from riot_bus_bridges.ros_test.segments import (
    HERE,
    LOOK_S,
    UNIT,
    Components,
    Crossings,
    is_colcon_test,
    leave_account,
    open_segments,
    package_lines,
    router_per_package,
)

_RMW = "rmw_zenoh_cpp"
_GRACE_S = END_S * 2 / 3
"""Seconds that an interrupted command has to end, before it and all its descendants are killed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosTest:
    """Options of `riot ros-test`.

    Attributes:
        router: Options of the router; its segments are not those of riot.toml but two on free ports of this machine.
    """

    router: RouterOptions = field(default_factory=RouterOptions)
    nodes: str | None = None
    dds: bool = False
    record: Path | None = None
    package: str = ""
    folder: Path | None = None
    account: Path | None = None
    words: Sequence[str] = ()


def run_tests(command: Sequence[str], asked: RosTest, *, warn: Callable[[str], None]) -> int:
    """Run a command to its end, or until SIGINT or SIGTERM, which it receives as SIGINT.

    None of its processes is left behind, not even when this process is killed.

    Returns:
        The command's exit status, negative for a signal.

    Raises:
        ConfigError: An option is wrong.
        EnvironmentFaultError: The command, or a bridge, cannot be started.
    """
    stop = threading.Event()
    with (
        ended_by_signals(stop.set),
        tempfile.TemporaryDirectory(prefix="riot-tests-", ignore_cleanup_errors=True) as text,
    ):
        folder = Path(text)
        if is_colcon_test(command):
            return _run_packages(command, asked, folder, stop, warn)
        return _run_one(command, asked, folder, stop, warn)


def _run_one(
    command: Sequence[str], asked: RosTest, folder: Path, stop: threading.Event, warn: Callable[[str], None]
) -> int:
    from riot_bus.control.router_process import Upkeep, router_of

    settings = _own_settings(asked)
    chosen = os.environ.get("RMW_IMPLEMENTATION") or _RMW
    if chosen != _RMW and not asked.dds:
        warn(
            f"warning: RMW_IMPLEMENTATION={chosen} is not {_RMW}, which nodes get\n  hint: --dds lets them keep theirs"
        )
    with router_of(asked.router, settings=settings, warn=warn) as service:
        with service:
            service.watch()
            with (
                Crossings(service.bus) as crossings,
                Launcher(quiet=False, scratch=folder) as launcher,
                open_segments(service, launcher, folder, nodes=asked.nodes, dds=asked.dds) as segments,
            ):
                components, upkeep = Components(service), Upkeep()

                def look() -> None:
                    upkeep()
                    components.look()

                status = _carried_out(launcher, command, segments.environment, asked.folder, stop, look)
                started = segments.placement.started()
            told = service.status()
            plan = told["plan"] or {}
        counts = service.bus.counts()
        behind = sum(segments.carried.get(topic, 0) for topic, each in counts.items() if each.received)
        passage = Passage(
            wanted=service.topics,
            counts=counts,
            crossed=behind if segments.domains else crossings.count(components.found),
            losses=service.bus.losses,
            hits=plan.get("hits_by_injection"),
            problems=plan.get("problems", {}),
            errors={each["name"]: (each["errors"], each["error"]) for each in told["interceptors"] if each["errors"]},
            recording=settings.record or "",
            components=components.found,
            domains=segments.domains,
            nodes=asked.nodes,
            started=started,
        )
    lines = passage.lines()
    for line in lines:
        warn(f"riot: {line}")
    if asked.account is not None:
        leave_account(asked.account, asked.package, lines, vacuous=bool(passage.vacuous))
    return status


def _run_packages(
    command: Sequence[str], asked: RosTest, folder: Path, stop: threading.Event, warn: Callable[[str], None]
) -> int:
    if asked.record is not None and asked.record.suffix == ".mcap":
        hint = "name a folder: each package has a log there"
        raise ConfigError("one log for the tests of several packages", where=f"--record {asked.record}", hint=hint)
    given = environment_of_others()
    (accounts := folder / "accounts").mkdir()
    with Launcher(quiet=False, scratch=folder) as launcher:
        hook = router_per_package(given, asked.words, folder=folder, accounts=accounts)
        status = _carried_out(launcher, command, {**given, **hook}, asked.folder, stop, lambda: None)
        lines = package_lines(accounts)
    for line in lines:
        warn(f"riot: {line}")
    return status


def _own_settings(asked: RosTest) -> RouterSettings:
    """Return the settings of a router that only this machine reaches, and that connects to no other router."""
    settings = settings_of(asked.router)
    record = settings.record
    if asked.record is not None:
        record = str(asked.record.absolute())
        if asked.record.suffix != ".mcap":
            asked.record.mkdir(parents=True, exist_ok=True)
            stem = file_stem(asked.package or (asked.folder or Path.cwd()).name)
            record = str(claim(asked.record.absolute(), None, stem))
    segments = {HERE: SegmentSettings(), UNIT: SegmentSettings()}
    return replace(settings, segments=segments, control=None, record=record)


def _carried_out(
    launcher: Launcher,
    command: Sequence[str],
    environment: Mapping[str, str],
    folder: Path | None,
    stop: threading.Event,
    look: Callable[[], None],
) -> int:
    """Run the command; return its exit status, negative for a signal."""
    if stop.is_set():
        return -signal.SIGINT
    where = folder or Path.cwd()
    try:
        process = launcher.start("tests", command, env=environment, cwd=where, directory=None)
    except EnvironmentFaultError as error:
        hint = f"it was to run in {where}"
        raise EnvironmentFaultError(error.message.replace("component 'tests'", repr(command[0])), hint=hint) from None
    killed_at = float("inf")
    while not launcher.wait([process], timeout=LOOK_S):
        if stop.is_set() and killed_at == float("inf"):
            launcher.interrupt(process, signal.SIGINT)
            killed_at = time.monotonic() + _GRACE_S
        if time.monotonic() > killed_at:
            launcher.interrupt(process, signal.SIGKILL)
        look()
    return process.status or 0
