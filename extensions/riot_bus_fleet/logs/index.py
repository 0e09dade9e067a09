"""Indexing: new and changed logs are read, each is committed on its own, and unchanged ones are not read again."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.log.info import log_info
from riot_bus.vocabulary.errors import RiotError
from riot_bus_fleet.logs.entry import LogEntry, TopicEntry
from riot_bus_fleet.logs.stores import open_store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from riot_bus.log.engine.limits import LogLimits
    from riot_bus.log.info import LogInfo
    from riot_bus_fleet.logs.catalogue import Catalogue
    from riot_bus_fleet.logs.entry import NamedBy, StoredLog
    from riot_bus_fleet.logs.stores import Store

_ROBOT = "robot"
_AHEAD = 4  # threads that are done find another log while the oldest one is awaited


@dataclass(slots=True)
class IndexReport:
    """Result of indexing.

    Attributes:
        fresh: Number of new or changed logs among these, which were read.
        damaged: Number of fresh logs of which something is missing, or that are not logs.
        gone: Number of logs that no longer exist.
        pruned: Number of logs that were removed from the catalogue.
        failures: Logs that could not be looked at, a line each.
    """

    logs: int = 0
    fresh: int = 0
    damaged: int = 0
    gone: int = 0
    pruned: int = 0
    failures: list[str] = field(default_factory=list)


def index(
    catalogue: Catalogue,
    roots: Sequence[str],
    *,
    robot: str | None = None,
    jobs: int = 4,
    prune: bool = False,
    scan: bool = False,
    progress: Callable[[int, str], None] = lambda _, __: None,
    stop: Callable[[], bool] = lambda: False,
    limits: LogLimits | None = None,
) -> IndexReport:
    """Bring a catalogue up to date.

    Args:
        catalogue: Catalogue that is updated.
        roots: Folders, logs and URLs of object stores.
        robot: Robot of logs that do not name one; by default the name of the folder below the root.
        jobs: Number of logs that are read at once.
        prune: Remove logs that are gone, instead of marking them.
        scan: Read all of each log of which only the summary was read so far, to find damage that the summary does
            not show.
        progress: Called with the number of logs so far and the current one.
        stop: Asked before each log whether to stop; what was read by then is kept.
        limits: Limits on what is read of a log; None for the usual ones.

    Raises:
        ConfigError: A root does not exist, or cannot be opened.
    """
    work = _Indexing(catalogue, robot, jobs, scan, progress, stop, limits)
    stores = [open_store(root) for root in roots]
    with ThreadPoolExecutor(max(1, jobs), thread_name_prefix="riot-index") as pool:
        for store in stores:
            work.index(store, pool)
    if prune:
        work.report.pruned = catalogue.prune()
    return work.report


@dataclass(slots=True)
class _Indexing:
    catalogue: Catalogue
    robot: str | None
    jobs: int
    scan: bool
    progress: Callable[[int, str], None]
    stop: Callable[[], bool]
    limits: LogLimits | None
    report: IndexReport = field(default_factory=IndexReport)
    reading: deque[Future[LogEntry]] = field(default_factory=deque)

    def index(self, store: Store, pool: ThreadPoolExecutor) -> None:
        seen: set[str] = set()
        failures: list[str] = []
        try:
            for log in _until(store.logs(failures.append), self.stop):
                self.report.logs += 1
                self.progress(self.report.logs, log.place)
                seen.add(log.place)
                known = self.catalogue.known(log.place)
                fresh = known is not None and (known.size, known.stamp) == (log.size, log.stamp)
                if known is None or not fresh or (self.scan and not known.scanned):
                    work = pool.submit(describe, store, log, self.robot, scan=self.scan, limits=self.limits)
                    self.reading.append(work)
                    self._commit(self.jobs + _AHEAD, failures)
                else:
                    self._keep(known)
            self._commit(0, failures)
        finally:
            for each in self.reading:
                each.cancel()
            self.reading.clear()
        self.report.failures += [*store.refused, *failures]
        if not failures and not self.stop():  # else a log that was not seen may still exist
            self.report.gone += self.catalogue.mark_gone(store.root, seen)

    def _commit(self, left: int, failures: list[str]) -> None:
        """Commit logs that were read, until only `left` are still being read."""
        while len(self.reading) > left:
            try:
                entry = self.reading.popleft().result()
            except RiotError as error:
                failures.append(str(error))
                continue
            self.catalogue.put(entry)
            self.report.fresh += 1
            self.report.damaged += bool(entry.problem or entry.lost)

    def _keep(self, known: LogEntry) -> None:
        if known.gone:
            self.catalogue.back(known.place)
        if self.robot is not None and known.named_by != "log" and known.robot != self.robot:
            self.catalogue.name(known.place, self.robot)


def _until(logs: Iterator[StoredLog], stop: Callable[[], bool]) -> Iterator[StoredLog]:
    for log in logs:
        if stop():
            return
        yield log


def describe(
    store: Store, log: StoredLog, robot: str | None = None, *, scan: bool = False, limits: LogLimits | None = None
) -> LogEntry:
    """Return the catalogue entry of a log, read from its summary if that is sound, else from all of it.

    Args:
        store: The store that holds the log.
        log: The log's entry in the store.
        robot: Robot of the log, unless the log names one itself.
        scan: Read all of it in any case, to find damage that the summary does not show.
        limits: Limits on what is read of it; None for the usual ones.

    Raises:
        EnvironmentFaultError: The store cannot deliver the log.
    """
    named: NamedBy = "folder" if robot is None else "option"
    name = robot if robot is not None else log.folder
    try:
        info = None
        if not scan:
            with store.excerpt(log) as path:
                info = _told(path, limits)
        if info is None or (info.scanned and store.partial):
            with store.whole(log) as path:
                info = log_info(path, scan=scan, limits=limits)
    except RiotError as error:
        if error.exit_code != 2:
            raise
        unread = LogEntry(place=log.place, size=log.size, stamp=log.stamp, robot=name, named_by=named)
        return replace(unread, readable=False, problem=error.message, scanned=True)
    told = info.metadata.get(_ROBOT, "")
    lost = 0 if info.account is None else info.account.total()
    problems = [str(info.loss)] if info.loss else []
    problems += [f"{lost} messages were lost while it was recorded"] if lost else []
    return LogEntry(
        place=log.place,
        size=log.size,
        stamp=log.stamp,
        robot=told or name,
        named_by="log" if told else named,
        problem=", ".join(problems),
        profile=info.profile,
        start=info.start,
        end=info.end,
        messages=info.count,
        lost=info.loss.messages + lost,
        topics=tuple(
            TopicEntry(each.topic, each.key, each.type, each.encoding, each.count, each.originals)
            for each in info.topics
        ),
        metadata=dict(info.metadata),
        scanned=info.scanned,
    )


def _told(path: Path, limits: LogLimits | None) -> LogInfo | None:
    """Return a log's description from its excerpt; None if all of the log is needed."""
    try:
        return log_info(path, scan=False, limits=limits)
    except RiotError:
        return None
