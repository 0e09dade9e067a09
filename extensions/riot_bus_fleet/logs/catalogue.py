"""The catalogue: an SQLite file of a fleet's logs. Each log is committed on its own, so it is safe to interrupt."""

from __future__ import annotations

import os
import sqlite3
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean
from riot_bus_fleet.logs.entry import LATEST, LogEntry, TopicEntry

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from riot_bus_fleet.logs.near_misses import FleetScan
    from riot_bus_fleet.logs.query import Query

_APPLICATION = int.from_bytes(b"RIOT")
_VERSION = 3  # of the tables
_BUSY_S = 30.0  # a guess: another process commits log by log, so it blocks for milliseconds
_LONGEST = 4096  # letters of a text from a log, as PATH_MAX: bounds what a hostile log stores
_COLUMNS = (
    "number, place, size, stamp, robot, named_by, readable, problem, profile, began, ended, messages, lost, gone, "
    "scanned"
)
_SCHEMA = """
CREATE TABLE logs(
    number INTEGER PRIMARY KEY,
    place TEXT NOT NULL UNIQUE,
    size INTEGER NOT NULL,
    stamp TEXT NOT NULL,
    robot TEXT NOT NULL,
    named_by TEXT NOT NULL,
    readable INTEGER NOT NULL,
    problem TEXT NOT NULL,
    profile TEXT NOT NULL,
    began INTEGER,
    ended INTEGER,
    messages INTEGER NOT NULL,
    lost INTEGER NOT NULL,
    gone INTEGER NOT NULL DEFAULT 0,
    indexed REAL NOT NULL,
    scanned INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE topics(
    log INTEGER NOT NULL REFERENCES logs(number) ON DELETE CASCADE,
    topic TEXT NOT NULL,
    key TEXT NOT NULL,
    type TEXT NOT NULL,
    encoding TEXT NOT NULL,
    count INTEGER NOT NULL,
    originals INTEGER NOT NULL
);
CREATE TABLE metadata(
    log INTEGER NOT NULL REFERENCES logs(number) ON DELETE CASCADE,
    name TEXT NOT NULL,
    value TEXT NOT NULL
);
CREATE INDEX logs_by_robot ON logs(robot, began);
CREATE INDEX logs_by_time ON logs(began);
CREATE INDEX topics_by_log ON topics(log);
CREATE INDEX metadata_by_log ON metadata(log);
CREATE TABLE scans(
    log INTEGER NOT NULL REFERENCES logs(number) ON DELETE CASCADE,
    rule TEXT NOT NULL,
    distance REAL,
    judged INTEGER NOT NULL,
    unknown INTEGER NOT NULL,
    holds INTEGER NOT NULL,
    problem TEXT NOT NULL,
    at REAL NOT NULL,
    PRIMARY KEY(log, rule)
);
CREATE TABLE moments(
    log INTEGER NOT NULL,
    rule TEXT NOT NULL,
    distance REAL NOT NULL,
    time INTEGER NOT NULL,
    told TEXT NOT NULL,
    FOREIGN KEY(log, rule) REFERENCES scans(log, rule) ON DELETE CASCADE
);
CREATE INDEX moments_by_scan ON moments(log, rule);
"""


def default_catalogue() -> Path:
    """Return the default path of the catalogue, in the user's data folder."""
    home = os.environ.get("XDG_DATA_HOME", "")
    return (Path(home) if home.startswith("/") else Path.home() / ".local" / "share") / "riot" / "catalogue.sqlite"


class Catalogue:
    """Catalogue of logs, for any threads and processes; a context manager. Raises ConfigError if the file is none."""

    def __init__(self, path: Path | None, *, create: bool = True) -> None:
        self.path = path
        self._lock = threading.RLock()
        if path is not None and not create and not path.is_file():
            raise ConfigError("there is no catalogue yet", where=str(path), hint="make one: riot fleet index FOLDER")
        try:
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(
                ":memory:" if path is None else path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False
            )
        except (OSError, sqlite3.Error) as error:
            raise ConfigError(f"cannot open the catalogue: {error}", where=str(path)) from error
        try:
            self._prepare()
        except BaseException:
            self._db.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; safe to call twice."""
        with self._lock:
            self._db.close()

    def put(self, entry: LogEntry) -> None:
        """Store what is known about a log, in place of what was known before."""
        row = {
            "place": entry.place,
            "size": min(entry.size, LATEST),
            "stamp": _text(entry.stamp),
            "robot": _text(entry.robot),
            "named_by": entry.named_by,
            "readable": entry.readable,
            "problem": _text(entry.problem),
            "profile": _text(entry.profile),
            "began": _bounded(entry.start),
            "ended": _bounded(entry.end),
            "messages": min(entry.messages, LATEST),
            "lost": min(entry.lost, LATEST),
            "indexed": time.time(),
            "scanned": entry.scanned,
        }
        names = ", ".join(row)
        news = ", ".join(f"{name} = excluded.{name}" for name in row if name != "place")
        statement = (
            f"INSERT INTO logs({names}) VALUES({', '.join('?' * len(row))}) "
            f"ON CONFLICT(place) DO UPDATE SET gone = 0, {news} RETURNING number"
        )
        topics = [
            (_text(each.topic), _text(each.key), _text(each.type), _text(each.encoding), each.count, each.originals)
            for each in entry.topics
        ]
        metadata = [(_text(name), _text(value)) for name, value in entry.metadata.items()][:1000]
        with self._transaction() as db:
            (number,) = db.execute(statement, tuple(row.values())).fetchone()
            for table in ("topics", "metadata", "scans"):
                db.execute(f"DELETE FROM {table} WHERE log = ?", (number,))  # noqa: S608 - ours
            db.executemany("INSERT INTO topics VALUES(?, ?, ?, ?, ?, ?, ?)", [(number, *each) for each in topics])
            db.executemany("INSERT INTO metadata VALUES(?, ?, ?)", [(number, *each) for each in metadata])

    def put_scan(self, found: FleetScan) -> None:
        """Store how near known logs came to a rule, in place of the results of an earlier scan for it."""
        rule, now = _text(found.rule), time.time()
        with self._transaction() as db:
            for log in found.logs:
                row = db.execute("SELECT number FROM logs WHERE place = ?", (log.place,)).fetchone()
                if row is None:
                    continue
                db.execute("DELETE FROM scans WHERE log = ? AND rule = ?", (*row, rule))
                distance = log.distance if log.nearest else None
                figures = log.judged, log.unknown, log.holds
                db.execute(
                    "INSERT INTO scans VALUES(?, ?, ?, ?, ?, ?, ?, ?)",
                    (*row, rule, distance, *figures, _text(log.problem), now),
                )
                moments = [(*row, rule, one.distance, _bounded(one.time), _text(one.told)) for one in log.nearest]
                db.executemany("INSERT INTO moments VALUES(?, ?, ?, ?, ?)", moments)

    def name(self, place: str, robot: str) -> None:
        """Set the robot of a log that does not name one itself."""
        with self._transaction() as db:
            db.execute(
                "UPDATE logs SET robot = ?, named_by = 'option' WHERE place = ? AND named_by != 'log'",
                (_text(robot), place),
            )

    def back(self, place: str) -> None:
        """Record that a log that was gone exists again, unchanged."""
        with self._transaction() as db:
            db.execute("UPDATE logs SET gone = 0 WHERE place = ?", (place,))

    def mark_gone(self, root: str, seen: Collection[str]) -> int:
        """Mark logs that no longer exist; return how many there are."""
        root = root.rstrip("/")
        with self._transaction() as db:
            rows = db.execute(
                "SELECT number, place FROM logs WHERE NOT gone AND (place = ?1 OR substr(place, 1, length(?2)) = ?2)",
                (root, f"{root}/"),
            ).fetchall()
            gone = [(number,) for number, place in rows if place not in seen]
            db.executemany("UPDATE logs SET gone = 1 WHERE number = ?", gone)
        return len(gone)

    def prune(self) -> int:
        """Remove the logs that are gone; return how many were removed."""
        with self._transaction() as db:
            return db.execute("DELETE FROM logs WHERE gone").rowcount

    def known(self, place: str) -> LogEntry | None:
        """Return what is known of a log, without topics and metadata."""
        with self._reading() as db:
            row = db.execute(f"SELECT {_COLUMNS} FROM logs WHERE place = ?", (place,)).fetchone()  # noqa: S608 - ours
        return None if row is None else _entry(row)

    def find(self, query: Query, *, limit: int | None = None, offset: int = 0) -> list[LogEntry]:
        """Return the logs that match a query, oldest first, without topics and metadata."""
        statement = (
            f"SELECT {_COLUMNS} FROM logs WHERE {query.condition} "  # noqa: S608 - fixed parts, see `Query`
            "ORDER BY began IS NULL, began, place LIMIT ? OFFSET ?"
        )
        with self._reading() as db:
            rows = db.execute(statement, (*query.parameters, -1 if limit is None else limit, offset)).fetchall()
        return [_entry(row) for row in rows]

    def count(self, query: Query) -> int:
        """Return how many logs match a query."""
        statement = f"SELECT count(*) FROM logs WHERE {query.condition}"  # noqa: S608 - fixed parts, see `Query`
        with self._reading() as db:
            return int(db.execute(statement, query.parameters).fetchone()[0])

    def show(self, name: str) -> LogEntry:
        """Return all that is known of a log.

        Args:
            name: Place or number of the log, or the end of its place if only one log matches.

        Raises:
            ConfigError: There is no such log, or there are several.
        """
        with self._reading() as db:
            found = self._named(db, name)
            topics = db.execute(
                "SELECT topic, key, type, encoding, count, originals FROM topics WHERE log = ? ORDER BY topic, key",
                (found[0],),
            ).fetchall()
            metadata = db.execute("SELECT name, value FROM metadata WHERE log = ?", (found[0],)).fetchall()
        return _entry(found, tuple(TopicEntry(*row) for row in topics), dict(metadata))

    def _named(self, db: sqlite3.Connection, name: str) -> tuple[Any, ...]:
        ways: list[tuple[str, str | int]] = [("place = ?", name), ("place = ?", str(Path(name).absolute()))]
        if name.isascii() and name.isdecimal() and len(name) < 18:
            ways.append(("number = ?", int(name)))
        ways.append(("substr(place, -length(?1)) = ?1", f"/{name.lstrip('/')}"))
        for condition, value in ways:
            statement = f"SELECT {_COLUMNS} FROM logs WHERE {condition} LIMIT 4"  # noqa: S608 - fixed parts
            rows = db.execute(statement, (value,)).fetchall()
            if len(rows) > 1:
                places = ", ".join(row[1] for row in rows[:3])
                raise ConfigError(f"{name!r} could be several logs", hint=f"say which, such as {places}")
            if rows:
                return tuple(rows[0])
        some = [row[0].rpartition("/")[2] for row in db.execute("SELECT place FROM logs LIMIT 10000")]
        raise ConfigError(f"the catalogue has no log {name!r}", where=str(self.path), hint=did_you_mean(name, some))

    def _prepare(self) -> None:
        try:
            if not self._tables():
                with suppress(sqlite3.OperationalError):  # another process is making it just now
                    self._db.execute("PRAGMA journal_mode = WAL")  # a commit then waits for no disk
                with self._transaction() as db:
                    if not self._tables():  # else another process was faster
                        _execute(db, _SCHEMA)
                        db.execute(f"PRAGMA application_id = {_APPLICATION}")
                        db.execute(f"PRAGMA user_version = {_VERSION}")
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.execute("PRAGMA foreign_keys = ON")
            (application,) = self._db.execute("PRAGMA application_id").fetchone()
            (version,) = self._db.execute("PRAGMA user_version").fetchone()
        except sqlite3.OperationalError as error:
            raise EnvironmentFaultError(f"the catalogue does not answer: {error}", where=str(self.path)) from error
        except sqlite3.DatabaseError as error:
            raise ConfigError(f"this is not a catalogue: {error}", where=str(self.path)) from error
        if application != _APPLICATION:
            raise ConfigError("this is not a catalogue, but another SQLite file", where=str(self.path))
        if version != _VERSION:
            hint = "delete it and run riot fleet index again"
            raise ConfigError(f"version {version} of the catalogue, not {_VERSION}", where=str(self.path), hint=hint)

    def _tables(self) -> int:
        return int(self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0])

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._reading() as db:
            db.execute("BEGIN IMMEDIATE")
            try:
                yield db
            except BaseException:
                db.execute("ROLLBACK")
                raise
            db.execute("COMMIT")

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            try:
                yield self._db
            except sqlite3.OperationalError as error:
                raise EnvironmentFaultError(f"the catalogue does not answer: {error}", where=str(self.path)) from error


def _execute(db: sqlite3.Connection, statements: str) -> None:
    for statement in statements.split(";"):  # `executescript` would commit before
        db.execute(statement)


def _entry(
    row: tuple[Any, ...], topics: tuple[TopicEntry, ...] = (), metadata: dict[str, str] | None = None
) -> LogEntry:
    values = dict(zip(_COLUMNS.split(", "), row, strict=True))
    values["start"], values["end"] = values.pop("began"), values.pop("ended")
    values |= {name: bool(values[name]) for name in ("readable", "gone", "scanned")}
    return LogEntry(**values, topics=topics, metadata=metadata or {})


def _text(text: str) -> str:
    """Return a text from a log, which is untrusted, in a form that the catalogue can hold."""
    return text[:_LONGEST].encode("utf-8", "replace").decode()


def _bounded(time: int | None) -> int | None:
    return None if time is None else min(max(time, 0), LATEST)
