"""The logs of one folder: their list, and the safe lookup of files by names from untrusted users."""

from __future__ import annotations

import stat
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from riot_bus.given_files import leads_out
from riot_bus.log.limits import tight_limits
from riot_bus.log.rosbag2 import files_of
from riot_bus.vocabulary.errors import ConfigError, RiotError, did_you_mean
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.entry import ENDING, LogEntry
from riot_bus_fleet.logs.index import index
from riot_bus_fleet.logs.query import parse_query

_MOST_FILES = 500
_IDLE, _LONGEST_REST_S = 9, 20.0
"""Rest between two scans, whatever is requested: a multiple of the last scan's duration, and the limit of it."""


class Library:
    """The logs below a folder, scanned on a separate thread, so that many or large logs delay nothing else."""

    def __init__(
        self,
        folder: Path,
        robot: str,
        *,
        catalogue: Path | None = None,
        failed: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.folder = folder.resolve()
        self._robot = robot
        self._failed = failed
        self._told: set[str] = set()
        self._catalogue = Catalogue(catalogue)
        self._bell = threading.Condition()
        self._wanted = self._done = 0
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="riot-agent-logs", daemon=True)

    def start(self) -> None:
        """Begin to scan."""
        self._thread.start()
        self._look()

    def close(self) -> None:
        """Stop scanning."""
        with self._bell:
            self._closing = True
            self._bell.notify_all()
        if self._thread.is_alive():
            self._thread.join(10.0)
        if not self._thread.is_alive():
            self._catalogue.close()

    def logs(self, query: str = "", *, offset: int = 0, limit: int = 100, look: int | None = None) -> dict[str, Any]:
        """Return the logs known so far, as JSON values, and request a new scan unless `look` is given.

        Args:
            look: Number of a scan, from an earlier answer; this answer is complete if that scan has ended.

        Raises:
            ConfigError: The query is invalid.
        """
        wanted = parse_query(query)
        limit = min(max(limit, 0), 500)
        number = self._look() if look is None else look
        with self._bell:
            complete = self._done >= number
        rows = self._catalogue.find(wanted, limit=limit, offset=max(offset, 0))
        return {
            "logs": [self._row(each) for each in rows],
            "count": self._catalogue.count(wanted),
            "complete": complete,
            "look": number,
        }

    def resolve(self, name: str) -> list[Path]:
        """Return the files of a log, or of one recording's folder; raises ConfigError if outside, or no logs."""
        where = "logs"
        if not name or not name.isprintable() or len(name) > 1000:
            raise ConfigError(f"{name[:80]!r} is not a path", where=where, hint="such as run.mcap")
        try:
            path = self._inside(self.folder / name, name)
            try:
                files = files_of(path)
            except ConfigError as error:
                error.where = f"logs: {name}"  # remote users must not see where the folder is
                raise
            if len(files) > _MOST_FILES:
                raise ConfigError(f"the folder {name!r} holds {len(files)} logs", where=where, hint="name one of them")
            found = [self._inside(each, name) for each in files]
            for each in found:
                if not stat.S_ISREG(each.stat().st_mode) or each.suffix != ENDING:
                    raise ConfigError(f"{name!r} is not a log", where=where, hint=f"their names end with {ENDING}")
        except OSError as error:
            known = [self._name(each) for each in self._catalogue.find(parse_query(""), limit=10_000)]
            hint = did_you_mean(name, known) or "riot fleet logs ROBOT lists what there is"
            raise ConfigError(f"cannot open {name!r}: {error.strerror}", where=where, hint=hint) from None
        return found

    def resolve_all(self, names: Sequence[str]) -> list[Path]:
        """Return the files of several names; raises ConfigError as `resolve` does, or if these are too many to open."""
        found = [path for name in names for path in self.resolve(name)]
        if len(found) > _MOST_FILES:
            raise ConfigError(f"{len(found)} logs at once are too many", where="logs", hint=f"at most {_MOST_FILES}")
        return found

    def _inside(self, path: Path, name: str) -> Path:
        if leads_out(path, self.folder):
            raise ConfigError(
                f"{name!r} is outside of the folder of logs", where="logs", hint="links that lead out are refused too"
            )
        return path.resolve()

    def _name(self, entry: LogEntry) -> str:
        return entry.place.removeprefix(f"{self.folder}/")

    def _row(self, entry: LogEntry) -> dict[str, Any]:
        names = ("size", "start", "end", "seconds", "messages", "lost", "readable")
        told = {name: getattr(entry, name) for name in names}
        return {"name": self._name(entry), **told, "problem": entry.problem[:200]}

    def _look(self) -> int:
        """Request a scan and return its number."""
        with self._bell:
            self._wanted = self._done + (2 if self._wanted > self._done else 1)  # a scan that has begun is too old
            self._bell.notify_all()
            return self._wanted

    def _run(self) -> None:
        rest = 0.0
        while True:
            with self._bell:
                self._bell.wait_for(lambda: self._closing or self._wanted > self._done)
                self._bell.wait_for(lambda: self._closing, rest)
                if self._closing:
                    return
            began = time.monotonic()
            try:
                report = index(
                    self._catalogue,
                    [str(self.folder)],
                    robot=self._robot,
                    jobs=1,
                    stop=lambda: self._closing,
                    limits=tight_limits(),
                )
                problems = report.failures
            except RiotError as error:
                problems = [str(error)]
            for each in set(problems) - self._told:
                self._told.add(each)
                self._failed(each)
            with self._bell:
                self._done += 1
            rest = min(_IDLE * (time.monotonic() - began), _LONGEST_REST_S)
