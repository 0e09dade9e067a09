"""The store of trials: a trial is never executed twice, and an interrupted run resumes.

Every step of the chain is a deterministic algorithm over the outcomes of its trials. So re-executing a step over
this store *is* resuming it, and re-executing a finished step costs nothing.
"""

from __future__ import annotations

import errno
import json
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Final, Protocol, runtime_checkable

from pydantic import TypeAdapter

from riot_bus.given_files import leads_out
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, OutOfTimeError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict

ATTEMPTS: Final = 3
"""Attempts to carry out a trial: one error may be chance, the third in a row is the result."""

_OUTCOME: TypeAdapter[Outcome] = TypeAdapter(Outcome)
_WAIT_S = 60.0
"""Time to wait for a lock on the file: copying or reading it takes much less, and should not end a campaign."""

_SETTINGS = (
    "PRAGMA journal_mode = WAL",
    "PRAGMA synchronous = NORMAL",  # a process crash loses nothing; a machine crash perhaps the last trials
)
_SCHEMA = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"
_CREATE = (
    "CREATE TABLE trials (number INTEGER PRIMARY KEY, key TEXT UNIQUE,"
    " verdict TEXT, signatures TEXT, seconds REAL, detail TEXT, outcome TEXT, injected TEXT) STRICT"
)
_TRIED = "SELECT injected, outcome FROM trials WHERE substr(key, 1, length(?)) = ? AND injected <> '' ORDER BY number"
_ROWS = "SELECT number, key, verdict, signatures, seconds, detail FROM trials ORDER BY number"
_PUT = "INSERT OR REPLACE INTO trials VALUES (NULL, ?, ?, ?, ?, ?, ?, ?)"


class TrialStore:
    """Outcomes by test case, in one SQLite file that others may read at the same time, by `stored_trials`.

    The file is in WAL mode, which needs a local disk. Each outcome is one statement, so an interruption leaves all of
    it or nothing.

    Raises:
        EnvironmentFaultError: The file is not such a store, or is locked for a minute.
        ConfigError: A link in its folder leads out of that.
    """

    NAME = "trials.sqlite"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        _check(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with _told(path):
            self._database = sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None, check_same_thread=False)
            for setting in _SETTINGS:
                self._database.execute(setting)
            if not _is_begun(self._database):
                self._begin()

    def __len__(self) -> int:
        with self._lock, _told(self.path):
            (count,) = self._database.execute("SELECT count(*) FROM trials").fetchone()
        return int(count)

    def get(self, key: str) -> Outcome | None:
        """Return the outcome of an earlier trial; None if there is none or it is not valid."""
        with self._lock, _told(self.path):
            row = self._database.execute("SELECT outcome FROM trials WHERE key = ?", (key,)).fetchone()
        return None if row is None else _outcome(row[0])

    def put(self, key: str, outcome: Outcome, case: TestCase | None = None) -> None:
        """Write an outcome to the file before returning; a full disk leaves no partial outcome.

        The key is that of the test case and of all else that decides its outcome. `tried` returns a case with
        injections.

        Raises:
            OSError: The disk is full.
        """
        with self._lock, _told(self.path):
            self._database.execute(_PUT, _row(key, outcome, case))

    def tried(
        self, scope: Mapping[str, object], log: Sequence[Message]
    ) -> Iterator[tuple[list[dict[str, Any]], int, Outcome]]:
        """Yield the rows of the injections, the seed and the outcome of each injected trial of a log."""
        begin, wanted = f"{_text(scope)}|", _identity(log)
        with self._lock, _told(self.path):
            rows = self._database.execute(_TRIED, (begin, begin)).fetchall()
        for injected, text in rows:
            case, outcome = json.loads(injected), _outcome(text)
            if outcome is not None and case["log"] == wanted:
                yield case["injections"], case["seed"], outcome

    def keep_only(self, part: str) -> int:
        """Delete all trials whose keys do not contain a text, free their space, and return their number."""
        with self._lock, _told(self.path):
            count = self._database.execute("DELETE FROM trials WHERE instr(key, ?) = 0", (part,)).rowcount
            if count:
                self._database.execute("VACUUM")
        return count

    def close(self) -> None:
        """Close the file, which is then one file again; safe to call twice."""
        self._database.close()

    def _begin(self) -> None:
        """Create the table, unless another process does so at the same time."""
        self._database.execute("BEGIN IMMEDIATE")
        with self._database:
            if not _is_begun(self._database):
                self._database.execute(_CREATE)


def stored_trials(path: Path) -> list[dict[str, object]]:
    """Return one row per trial of a store, without observations, in the order in which the trials ended.

    Nothing is written. A trial that is executed again gets a new number.

    Raises:
        EnvironmentFaultError: The file is not such a store.
        ConfigError: As of `TrialStore`.
    """
    if not path.is_file():
        return []
    _check(path)
    with (
        _told(path),
        closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_WAIT_S)) as file,
    ):
        if not _is_begun(file):
            return []
        found = file.execute(_ROWS)
        names = [column[0] for column in found.description]
        return [dict(zip(names, row, strict=True)) for row in found]


def _check(path: Path) -> None:
    """Raise ConfigError if a link in the store's folder leads out of it: SQLite writes to the files beside it, too."""
    folder = path.parent
    for each in (folder, *(folder.iterdir() if folder.is_dir() else ())):
        if leads_out(each, folder.parent):
            raise ConfigError(f"this link leads out of {str(folder.parent)!r}", where=str(each), hint="remove it")


def _is_begun(database: sqlite3.Connection) -> bool:
    """Return whether the table is there; raise DatabaseError for any other schema: it may have triggers and views."""
    found = database.execute(_SCHEMA).fetchall()
    if found not in ([], [(_CREATE,)]):
        raise sqlite3.DatabaseError("another version of riot, or something else, has made it")
    return bool(found)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn errors of SQLite into those that the rest of riot uses."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0)
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        hint = "another riot may work in this folder" if code == sqlite3.SQLITE_BUSY else "move it away"
        raise EnvironmentFaultError(f"cannot use the store of trials: {error}", where=str(path), hint=hint) from error


def _text(scope: Mapping[str, object]) -> str:
    return json.dumps(scope, sort_keys=True, default=str)


def _injected(case: TestCase | None) -> str:
    if case is None or not case.injections:
        return ""
    rows = [each.row() for each in case.injections]
    return json.dumps({"log": _identity(case.messages), "seed": case.seed, "injections": rows}, default=repr)


def _identity(log: Sequence[Message]) -> list[object]:
    """Return what identifies a log of a campaign: its first and last message and its number of messages."""
    return [len(log), *(log[place].digest().hex() for place in (0, -1) if log)]


def _row(key: str, outcome: Outcome, case: TestCase | None) -> tuple[object, ...]:
    signatures = "\n".join(each.signature for each in outcome.violations)
    shown = [text.encode(errors="backslashreplace").decode() for text in (signatures, outcome.detail)]
    text = json.dumps(asdict(outcome), separators=(",", ":"))
    return key, str(outcome.verdict), shown[0], outcome.seconds, shown[1], text, _injected(case)


def _outcome(text: str) -> Outcome | None:
    try:
        return _OUTCOME.validate_python(json.loads(text))
    except (ValueError, RecursionError):
        return None


@runtime_checkable
class _RunsEach(Protocol):
    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]: ...


class StoredRunner:
    """A `Runner` that looks into the store first.

    Args:
        runner: Runner of trials that are not in the store.
        scope: Everything besides the test case that decides an outcome (system, unit, what is observed).
        told: Function that is called with each outcome.
        unjudged: Whether a case that cannot be judged has an outcome like any other; else it is an error.
        until: Function that returns the time of the monotonic clock at which execution ends; None for never.
    """

    def __init__(
        self,
        runner: Runner,
        store: TrialStore,
        *,
        scope: Mapping[str, object],
        told: Callable[[Outcome], None] | None = None,
        unjudged: bool = False,
        until: Callable[[], float | None] = lambda: None,
    ) -> None:
        self._runner = runner
        self._store = store
        self._scope = _text(scope)
        self._told = told
        self._unjudged = unjudged
        self._until = until
        self.trials = 0
        self.executed = 0

    @property
    def parallelism(self) -> int:
        """How many trials run at once."""
        return self._runner.parallelism

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Return the outcomes of all cases, executing only new ones.

        Raises:
            EnvironmentFaultError: A trial could not be carried out, several times over.
            OutOfTimeError: There are new cases, and the time is over.
        """
        keys = [f"{self._scope}|{case.digest()}" for case in cases]
        stored = {key: self._store.get(key) for key in keys}
        known = {key: outcome for key, outcome in stored.items() if outcome is not None and self._counts(outcome)}
        fresh = {key: case for key, case in zip(keys, cases, strict=True) if key not in known}
        for attempt in range(ATTEMPTS):
            pending = {key: case for key, case in fresh.items() if key not in known}
            if not pending:
                break
            for key, outcome in self._executed(pending):
                self.executed += 1
                if self._counts(outcome):
                    known[key] = outcome
                elif attempt == ATTEMPTS - 1 or outcome.verdict is Verdict.UNJUDGED:
                    raise EnvironmentFaultError(f"a trial could not be carried out: {outcome.detail}")
        self.trials += len(cases)
        outcomes = [known[key] for key in keys]
        if self._told:
            for outcome in outcomes:
                self._told(outcome)
        return outcomes

    def _executed(self, pending: Mapping[str, TestCase]) -> Iterator[tuple[str, Outcome]]:
        """Execute trials and yield their outcomes; if time is limited, in batches that run in parallel."""
        left = dict(pending)
        while left:
            until = self._until()
            if until is not None and time.monotonic() >= until:
                raise OutOfTimeError("the time was over", hint="give more time, or run the same command again to go on")
            some = left if until is None else dict(islice(left.items(), self.parallelism))
            yield from zip(some, self._execute(some), strict=True)
            left = {key: case for key, case in left.items() if key not in some}

    def _counts(self, outcome: Outcome) -> bool:
        return outcome.judged or (self._unjudged and outcome.verdict is Verdict.UNJUDGED)

    def _execute(self, cases: Mapping[str, TestCase]) -> Sequence[Outcome]:
        """Execute trials; if the runner reports the end of each, it is stored at once, so interruptions lose none."""
        keys = list(cases)

        def ended(number: int, outcome: Outcome) -> None:
            if self._counts(outcome):
                self._store.put(keys[number], outcome, cases[keys[number]])

        if isinstance(self._runner, _RunsEach):
            return self._runner.each(list(cases.values()), ended)
        outcomes = self._runner.run(list(cases.values()))
        for number, outcome in enumerate(outcomes):
            ended(number, outcome)
        return outcomes
