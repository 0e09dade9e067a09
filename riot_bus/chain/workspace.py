"""Where a chain of steps works: the system, the output folder, the pool, the store, and who is told."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

from riot_bus.campaign.store import StoredRunner, TrialStore
from riot_bus.chain.logs import read_messages
from riot_bus.findings.records import FindingRecord
from riot_bus.log.reader import LogReader
from riot_bus.sut.context import Context, open_system
from riot_bus.sut.local import LocalRunner, Pool
from riot_bus.sut.system_trial import SystemTrial
from riot_bus.sut.unit_trial import UnitTrial
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean
from riot_bus.vocabulary.trial import Runner, TestCase, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.sut.activity import Idle
    from riot_bus.sut.system import RunPace, Unit
    from riot_bus.vocabulary.message import Message

__all__ = ["Narrator", "Step", "Workspace", "open_finding"]

_ATTEMPTS = 3


class Narrator(Protocol):
    """Is told how the work goes; console, JSON lines, or nobody."""

    def begin(self, step: str) -> None:
        """A step starts."""
        ...

    def progress(self, done: int, total: int | None, note: str) -> None:
        """Trials of the current step so far."""
        ...

    def end(self, step: str, text: str) -> None:
        """A step has ended, with its result in a line."""
        ...


class Silent:
    """A narrator that says nothing."""

    def begin(self, step: str) -> None:
        """Say nothing."""

    def progress(self, done: int, total: int | None, note: str) -> None:
        """Say nothing."""

    def end(self, step: str, text: str) -> None:
        """Say nothing."""


@dataclass(slots=True)
class Step:
    """One running step: its runners and its figures."""

    workspace: Workspace
    name: str
    started: float = field(default_factory=time.monotonic)
    runners: list[StoredRunner] = field(default_factory=list)

    @property
    def trials(self) -> int:
        """Trials asked so far, whether executed now or earlier."""
        return sum(runner.trials for runner in self.runners)

    @property
    def seconds(self) -> float:
        """Time since the step began."""
        return round(time.monotonic() - self.started, 2)

    def progress(self, done: int, total: int | None, note: str) -> None:
        """Pass progress on to the narrator."""
        self.workspace.narrator.progress(done, total, note)

    def unit_runner(self, unit: str) -> StoredRunner:
        """Return a runner for trials of a unit alone."""
        trial = UnitTrial(self.workspace.context, unit, idle=self.workspace.idle(unit))
        return self._stored(LocalRunner(trial, self.workspace.pool), {"unit": unit})

    def system_runner(self, *, observe: Sequence[str], pace: RunPace) -> StoredRunner:
        """Return a runner for runs of the whole system."""
        trial = SystemTrial(self.workspace.context, pace, tuple(observe))
        return self._stored(LocalRunner(trial, self.workspace.pool), {"observe": list(observe), **pace.model_dump()})

    def _stored(self, runner: Runner, scope: dict[str, object]) -> StoredRunner:
        scope = {"system": self.workspace.fingerprint, **scope}
        stored = StoredRunner(runner, self.workspace.store, scope=scope)
        self.runners.append(stored)
        return stored


class Workspace:
    """A system and a folder to work in; a context manager that leaves no process behind.

    Args:
        system: Path of riot.toml.
        out: Folder for everything that is written.
        jobs: Trials at once; 0 for one per processor.
        seed: Seed of everything random.
        narrator: Is told how it goes.
    """

    def __init__(
        self, system: Path, out: Path, *, jobs: int = 0, seed: int = 0, narrator: Narrator | None = None
    ) -> None:
        self.context: Context = open_system(system)
        self.out = out
        self.seed = seed
        self.jobs = jobs or os.cpu_count() or 1
        self.narrator: Narrator = narrator or Silent()
        self.fingerprint = self.context.fingerprint()
        self.store = TrialStore(out / "trials" / "trials.jsonl")
        self._pool: Pool | None = None
        self._idle: dict[str, Idle] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.close()

    @property
    def pool(self) -> Pool:
        """The processes that run trials, started when first needed."""
        if self._pool is None:
            self._pool = Pool(self.jobs, keep=self.out / "trials")
        return self._pool

    @contextmanager
    def step(self, name: str) -> Iterator[Step]:
        """Begin a step; what it says at its end goes through `narrator.end`."""
        self.narrator.begin(name)
        yield Step(self, name)

    def unit(self, name: str | None) -> tuple[str, Unit]:
        """Return the unit to test."""
        chosen = self.context.file.choose_unit(name)
        return chosen, self.context.file.unit[chosen]

    def idle(self, unit: str) -> Idle:
        """Return what a unit does without input (measured once)."""
        if unit not in self._idle:
            from riot_bus.sut.calibration import measure_idle

            self._idle[unit] = measure_idle(self.context, unit, self.pool)
        return self._idle[unit]

    def nominal_log(self) -> Path:
        """Return the nominal log: the one that riot.toml names, or a recording of a nominal run made now.

        Raises:
            EnvironmentFaultError: The system does not start.
            ConfigError: The system fails in a nominal run already, or the named log is not there.
        """
        file = self.context.file
        if file.system.nominal is not None:
            path = file.root / file.system.nominal
            if not path.is_file():
                raise ConfigError(f"the nominal log {file.system.nominal!r} is not there", where=str(file.path))
            return path
        path = self.out / "nominal.mcap"
        if not path.is_file() or self._recorded_otherwise(path):
            self._record(path, file.system.nominal_run)
        return path

    def _recorded_otherwise(self, path: Path) -> bool:
        with LogReader(path) as reader:
            return reader.metadata.get("seed") != str(self.seed)

    def _record(self, path: Path, pace: RunPace) -> None:
        self.out.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial.mcap")
        trial = SystemTrial(self.context, pace, record=partial)
        for _ in range(_ATTEMPTS):
            partial.unlink(missing_ok=True)
            outcome = self.pool.execute(trial, TestCase(seed=self.seed))
            if outcome.verdict is not Verdict.ERROR:
                break
        if outcome.verdict is Verdict.ERROR:
            raise EnvironmentFaultError(f"the nominal run could not be carried out: {outcome.detail}")
        if outcome.verdict is Verdict.FAIL:
            violation = outcome.violations[0]
            raise ConfigError(
                f"the system fails in a nominal run: {violation.signature} ({violation.detail})",
                hint="RIOT starts from a run that works; mend the system, its riot.toml or its monitors first",
            )
        partial.rename(path)

    def unit_log(self, name: str) -> tuple[Message, ...]:
        """Return the messages of the nominal log that are inputs of a unit.

        Raises:
            ConfigError: The log holds none.
        """
        file, registry = self.context.file, self.context.registry
        unit = file.unit[name]
        path = file.root / unit.log if unit.log else self.nominal_log()
        component = file.components[unit.component or name]
        log = read_messages(path, registry=registry)
        messages = tuple(
            message for message in log if any(registry.matches(topic, message.key) for topic in component.inputs)
        )
        if not messages:
            raise ConfigError(
                f"the log holds nothing on the inputs of {name!r} ({', '.join(component.inputs) or 'none declared'})",
                where=str(path),
                hint=did_you_mean(next(iter(component.inputs), ""), {registry.topic(message.key) for message in log}),
            )
        return messages

    @property
    def findings(self) -> Path:
        """Folder of all findings."""
        return self.out / "findings"


def open_finding(path: Path) -> tuple[Path, FindingRecord]:
    """Find a finding by its folder, or the only one in an output folder.

    Raises:
        ConfigError: There is none, or there are several.
    """
    if FindingRecord.exists(path):
        return path, FindingRecord.load(path)
    inside = sorted(folder.parent for folder in (path / "findings").glob(f"*/{FindingRecord.FILE}"))
    if len(inside) == 1:
        return inside[0], FindingRecord.load(inside[0])
    if not inside:
        near = did_you_mean(
            path.name, [folder.name for folder in path.parent.glob("*") if FindingRecord.exists(folder)]
        )
        raise ConfigError(f"no finding at {str(path)!r}", hint=near or "run `riot test` first, or name its folder")
    names = ", ".join(str(folder) for folder in inside[:5])
    raise ConfigError(f"{len(inside)} findings in {str(path)!r}", hint=f"name one of: {names}")
