"""The store of trials: what was asked once is never executed again, and a run that was cut off resumes.

Every step of the chain is a deterministic algorithm over the answers to its questions. So re-executing a step over
this store *is* resuming it, and re-executing a finished step costs nothing.
"""

from __future__ import annotations

import json
import threading
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from pydantic import TypeAdapter, ValidationError

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
        """Keep an outcome; on disk before this returns."""
        raw = asdict(outcome)
        line = json.dumps({"key": key, "outcome": raw}, separators=(",", ":"))
        with self._lock:
            self._outcomes[key] = raw
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(line + "\n")

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
    def each(self, cases: Sequence[TestCase]) -> Iterator[tuple[int, Outcome]]: ...


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
            keys_pending = list(pending)
            for number, outcome in _each(self._runner, list(pending.values())):
                key = keys_pending[number]
                self.executed += 1
                if outcome.verdict is not Verdict.ERROR:
                    self._store.put(key, outcome)
                    known[key] = outcome
                elif attempt == _ATTEMPTS - 1:
                    raise EnvironmentFaultError(f"a trial could not be carried out: {outcome.detail}")
        self.trials += len(cases)
        outcomes = [known[key] for key in keys]
        if self._told:
            for outcome in outcomes:
                self._told(outcome)
        return outcomes


def _each(runner: Runner, cases: Sequence[TestCase]) -> Iterable[tuple[int, Outcome]]:
    """Yield outcomes as they end where a runner can tell them so, so that an end in between loses none."""
    if isinstance(runner, _RunsEach):
        return runner.each(cases)
    return enumerate(runner.run(cases))
