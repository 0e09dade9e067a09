"""The store of trials: what was asked once is never executed again, and a run that was cut off resumes.

Every step of the chain is a deterministic algorithm over the answers to its questions. So re-executing a step over
this store *is* resuming it, and re-executing a finished step costs nothing.
"""

from __future__ import annotations

import errno
import json
import os
import threading
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from pydantic import TypeAdapter, ValidationError

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.vocabulary.trial import Runner, TestCase

__all__ = ["StoredRunner", "TrialStore"]

_OUTCOME: TypeAdapter[Outcome] = TypeAdapter(Outcome)
_ATTEMPTS = 3


class TrialStore:
    """Outcomes by test case, as JSON lines that are only ever appended to."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._outcomes: dict[str, dict[str, Any]] = {}
        self.unreadable = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            self._read()

    def __len__(self) -> int:
        return len(self._outcomes)

    def get(self, key: str) -> Outcome | None:
        """Return the outcome of an earlier trial, None if there was none or its line is damaged."""
        raw = self._outcomes.get(key)
        if raw is None:
            return None
        try:
            return _OUTCOME.validate_python(raw)
        except ValidationError:
            return None

    def put(self, key: str, outcome: Outcome) -> None:
        """Keep an outcome, in the file before this returns; a disk that is full takes no half of it."""
        raw = asdict(outcome)
        line = json.dumps({"key": key, "outcome": raw}, separators=(",", ":")).encode() + b"\n"
        with self._lock, self.path.open("ab", buffering=0) as stream:
            size = stream.seek(0, os.SEEK_END)
            try:
                if stream.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
            except OSError:
                stream.truncate(size)
                raise
            self._outcomes[key] = raw

    def _read(self) -> None:
        """Read all whole lines; a line that a kill cut off in the middle is ended and not used."""
        with self.path.open("rb") as stream:
            data = stream.read()
        for line in data.splitlines():
            try:
                record = json.loads(line)
                self._outcomes[str(record["key"])] = dict(record["outcome"])
            except (ValueError, KeyError, TypeError):
                self.unreadable += 1
        if data and not data.endswith(b"\n"):
            with self.path.open("ab") as stream:
                stream.write(b"\n")


@runtime_checkable
class _RunsEach(Protocol):
    def each(self, cases: Sequence[TestCase], ended: Callable[[int, Outcome], None]) -> Sequence[Outcome]: ...


class StoredRunner:
    """A `Runner` that asks the store first.

    Args:
        runner: Executes what the store does not know.
        store: Where outcomes are kept.
        scope: Everything besides the test case that decides an outcome (system, unit, what is observed).
        told: Called after each outcome.
    """

    def __init__(
        self,
        runner: Runner,
        store: TrialStore,
        *,
        scope: Mapping[str, object],
        told: Callable[[Outcome], None] | None = None,
    ) -> None:
        self._runner = runner
        self._store = store
        self._scope = json.dumps(scope, sort_keys=True, default=str)
        self._told = told
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
        """
        keys = [f"{self._scope}|{case.digest()}" for case in cases]
        known = {key: outcome for key in keys if (outcome := self._store.get(key)) is not None}
        fresh = {key: case for key, case in zip(keys, cases, strict=True) if key not in known}
        for attempt in range(_ATTEMPTS):
            pending = {key: case for key, case in fresh.items() if key not in known}
            if not pending:
                break
            for key, outcome in zip(pending, self._execute(pending), strict=True):
                self.executed += 1
                if outcome.verdict is not Verdict.ERROR:
                    known[key] = outcome
                elif attempt == _ATTEMPTS - 1:
                    raise EnvironmentFaultError(f"a trial could not be carried out: {outcome.detail}")
        self.trials += len(cases)
        outcomes = [known[key] for key in keys]
        if self._told:
            for outcome in outcomes:
                self._told(outcome)
        return outcomes

    def _execute(self, cases: Mapping[str, TestCase]) -> Sequence[Outcome]:
        """Execute trials; each is kept as it ends, where it ends if a runner tells so: an interruption loses none."""
        keys = list(cases)

        def ended(number: int, outcome: Outcome) -> None:
            if outcome.verdict is not Verdict.ERROR:
                self._store.put(keys[number], outcome)

        if isinstance(self._runner, _RunsEach):
            return self._runner.each(list(cases.values()), ended)
        outcomes = self._runner.run(list(cases.values()))
        for number, outcome in enumerate(outcomes):
            ended(number, outcome)
        return outcomes
