"""The workspace of the steps: a system, its output folder, runners, the store of trials, and listeners."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Self

from riot_bus.campaign.store import ATTEMPTS, StoredRunner, TrialStore
from riot_bus.chain.base.logs import inputs_of, read_messages
from riot_bus.events import FindingWritten, Listener, Listeners, StepFinished, StepProgress, StepStarted, TrialFinished
from riot_bus.findings.records import Artefact, FindingRecord
from riot_bus.findings.steps import ChainStep
from riot_bus.given_files import given_file
from riot_bus.log.reader import LogReader
from riot_bus.plugins import hook
from riot_bus.pool.nominal import needs_baseline, why_not_told
from riot_bus.pool.runners import LocalRunners, RunnerFactory
from riot_bus.report.regression import write_regression_test, write_reproduce
from riot_bus.system.system_file import RunPace
from riot_bus.trial.baseline import Baseline
from riot_bus.trial.context import Context, open_system
from riot_bus.types.learnt import learn_types
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError, did_you_mean
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict

_LOG = logging.getLogger(__name__)
NOMINAL = "nominal.mcap"
"""Name of the recorded nominal run in an output folder."""


@dataclass(slots=True)
class StepRun:
    """One running step: its workspace, its runners, its figures, and the parameters that nodes have refused."""

    workspace: Workspace
    name: str
    started: float = field(default_factory=time.monotonic)
    runners: list[StoredRunner] = field(default_factory=list)
    refused: dict[str, list[str]] = field(default_factory=dict)

    @property
    def trials(self) -> int:
        """Trials asked so far, whether executed now or earlier."""
        return sum(runner.trials for runner in self.runners)

    @property
    def seconds(self) -> float:
        """Time since the step began."""
        return round(time.monotonic() - self.started, 2)

    def progress(self, done: int, total: int | None, note: str, left: float | None = None) -> None:
        """Tell how far the step has got; see `StepProgress`."""
        self.workspace.tell(StepProgress(self.name, done, total, note, left))

    def told(self, outcome: Outcome) -> None:
        """Report the outcome of a trial."""
        for name, why in dict(outcome.statistics.get("refused", {})).items():
            self.refused.setdefault(name, []).append(why)
        first = outcome.violations[0] if outcome.violations else None
        signature, detail = (first.signature, first.detail) if first else (None, outcome.detail)
        self.workspace.tell(TrialFinished(self.name, outcome.verdict.value, signature, detail, outcome.seconds))

    def end(self, text: str, *, folder: Path | None = None, record: Artefact | None = None) -> None:
        """Report the result of the step, what running nodes have refused, and what it has written."""
        for name, why in self.refused.items():
            text += f"; param:{name} was refused in {counted(len(why), 'run')} (last: {why[-1]})"
        dump = None if record is None else record.model_dump(mode="json")
        where = None if folder is None else str(folder)
        self.workspace.tell(StepFinished(self.name, text, self.seconds, self.trials, where, dump))

    def unit_runner(self, unit: str, *, unjudged: bool = False) -> StoredRunner:
        """Return a runner for trials of a unit alone.

        Args:
            unit: The unit.
            unjudged: Whether a case that cannot be judged has an outcome, too, instead of being an error.
        """
        workspace = self.workspace
        runner = workspace.runners.unit(unit, lambda: workspace.unit_log(unit))
        return self._stored(runner, self._unit_scope(unit), unjudged=unjudged)

    def tried(self, unit: str) -> list[tuple[list[dict[str, Any]], int, Outcome]]:
        """Return earlier trials of a unit's nominal log: the injections as rows, the seed, and the outcome."""
        log = self.workspace.unit_log(unit)
        return list(self.workspace.store.tried(self._unit_scope(unit), log))

    def system_runner(
        self,
        *,
        observe: Sequence[str],
        pace: RunPace,
        judged: tuple[str, Baseline] | None = None,
        unjudged: bool = False,
        timed: bool = True,
    ) -> StoredRunner:
        """Return a runner for runs of the whole system; see `RunnerFactory.system` and `unit_runner`."""
        runner = self.workspace.runners.system(pace, observe=observe, judged=judged, timed=timed)
        scope = {"system": self.workspace.fingerprint, "observe": list(observe), **pace.model_dump()}
        return self._stored(runner, scope | {"judged": judged[0]} if judged else scope, unjudged=unjudged)

    def _unit_scope(self, unit: str) -> dict[str, object]:
        return {"system": self.workspace.fingerprint, "unit": unit}

    def _stored(self, runner: Runner, scope: dict[str, object], *, unjudged: bool) -> StoredRunner:
        store = self.workspace.store
        until = lambda: self.workspace.until  # noqa: E731 - it changes
        stored = StoredRunner(runner, store, scope=scope, told=self.told, unjudged=unjudged, until=until)
        self.runners.append(stored)
        return stored


class Workspace:
    """A system and a folder to work in; a context manager that leaves no process behind.

    Args:
        system: Path of riot.toml.
        out: Folder for everything that is written.
        jobs: Number of trials at once; 0 for one on each processor, and more for units that mostly wait.
        seed: Seed of everything random.
        listeners: Listeners for everything that happens.
        runners: Factory of the steps' runners; processes of this machine by default.
        fresh: Whether to measure nominal trials again, even if an earlier command has stored their results.
        executor: Address of the cluster that executes trials: `dask://HOST:PORT`; None for this machine.

    Attributes:
        until: Time of the monotonic clock after which no more trials are executed; None for no limit.
    """

    def __init__(
        self,
        system: Path,
        out: Path,
        *,
        jobs: int = 0,
        seed: int = 0,
        listeners: Iterable[Listener] = (),
        runners: RunnerFactory | None = None,
        fresh: bool = False,
        executor: str | None = None,
    ) -> None:
        if (out / NOMINAL).is_file():
            given_file(out / NOMINAL, inside=out)
        self.context: Context = open_system(system)
        self.out = out
        self.seed = seed
        self.jobs = jobs or os.cpu_count() or 1
        self.tell = Listeners(listeners)
        self.fingerprint = self.context.fingerprint()
        self.store = TrialStore(out / "trials" / TrialStore.NAME)
        self.runners: RunnerFactory = runners or LocalRunners(
            self.context,
            jobs=jobs,
            keep=out / "trials",
            fresh=fresh,
            workers=partial(hook("workers", "riot_bus_cluster"), executor, self.context, jobs) if executor else None,
        )
        self.until: float | None = None
        self._logs: dict[Path, tuple[Message, ...]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.runners.close()
        self.store.close()

    @contextmanager
    def step(self, name: str) -> Iterator[StepRun]:
        """Begin a step; `StepRun.end` ends it."""
        self.tell(StepStarted(name))
        yield StepRun(self, name)

    def carry_out(self, step: ChainStep, folder: Path, **options: Any) -> Artefact:
        """Carry out a step of the chain on a finding and write its record.

        Args:
            step: The step.
            folder: The finding.
            options: Options of the step's function.

        Raises:
            ConfigError: The step before has not been done.
            InconclusiveError: The step cannot say anything about this finding.
        """
        if FindingRecord.load(folder).whole_system:
            raise InconclusiveError(
                "this was found in runs of the whole system: its log has what came from outside, not what its unit got",
                where=str(folder),
                hint="`riot reproduce` plays that log; `riot test` looks for the same in the unit alone",
            )
        with self.step(step.name) as run:
            found = step.function(run, folder, **options)
            figures = {"seed": self.seed, "trials": run.trials, "seconds": run.seconds}
            record = found.model_copy(update=figures)
            record.save(folder)
            run.end(record.summary, folder=folder, record=record)
        return record

    def write_finding(self, folder: Path, finding: FindingRecord) -> None:
        """Write the record of a finding, and the files that run its log again."""
        finding.save(folder)
        write_reproduce(folder)
        write_regression_test(folder, finding)

    def tell_finding(self, step: str, folder: Path, finding: FindingRecord) -> None:
        """Report a finding that a step has written."""
        self.tell(FindingWritten(step, str(folder), finding.id, finding.signature, occurrences=finding.occurrences))

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
                raise ConfigError(f"the nominal log {file.system.nominal!r} does not exist", where=str(file.path))
            return path
        path = self.out / NOMINAL
        if not path.is_file() or self._recorded_otherwise(path):
            self._record(path, file.system.nominal_run)
        return path

    def _recorded_otherwise(self, path: Path) -> bool:
        with LogReader(path) as reader:
            return reader.metadata.get("seed") != str(self.seed)

    def _record(self, path: Path, pace: RunPace) -> None:
        self.out.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial.mcap")
        runner = self.runners.system(pace, record=partial)
        failed: list[str] = []
        for attempt in range(ATTEMPTS):
            partial.unlink(missing_ok=True)
            (outcome,) = runner.run([TestCase(seed=self.seed, again=attempt)])
            if outcome.verdict is Verdict.FAIL:
                failed.append(f"{outcome.violations[0].signature} ({outcome.violations[0].detail})")
            elif outcome.verdict is not Verdict.ERROR:
                break
        if failed:
            told = f"the system fails in {len(failed)} of {attempt + 1} nominal runs: {failed[0]}"
            if len(failed) == ATTEMPTS:  # the system is broken; fewer failures are only warned of
                hint = "RIOT starts from a run that works; mend the system, its riot.toml or its monitors first"
                raise ConfigError(told, hint=hint)
            _LOG.warning("%s", told)
        if not outcome.judged:
            raise EnvironmentFaultError(f"the nominal run could not be carried out: {outcome.detail}")
        partial.rename(path)

    def nominal_messages(self) -> tuple[Message, ...]:
        """Return the messages of the nominal log; raises as `nominal_log`."""
        return self._messages(self.nominal_log())

    def _messages(self, path: Path) -> tuple[Message, ...]:
        """Return the messages of a log; several steps need those of the nominal one, so it is read once."""
        if path not in self._logs:
            self._logs[path] = read_messages(path, registry=self.context.registry)
            learn_types(self._logs[path], self.context.registry)
        return self._logs[path]

    def unit_log(self, name: str) -> tuple[Message, ...]:
        """Return the messages of the nominal log that are inputs of a unit.

        Raises:
            ConfigError: The log holds none.
        """
        file, registry = self.context.file, self.context.registry
        unit = file.unit[name]
        path = file.root / unit.log if unit.log else self.nominal_log()
        return inputs_of(name, self._messages(path), file=file, registry=registry, path=path)

    def known_unit_log(self, name: str) -> tuple[Message, ...]:
        """Return `unit_log` if there is a nominal log already, else no messages: none is recorded for this."""
        file = self.context.file
        recorded = (self.out / NOMINAL).is_file()
        return self.unit_log(name) if recorded or file.unit[name].log or file.system.nominal else ()

    def judged_in_system(
        self, finding: FindingRecord, driving: tuple[Message, ...]
    ) -> tuple[tuple[str, Baseline] | None, str]:
        """Return what detects a finding in runs of the whole system, and why nothing can; both may be empty.

        Args:
            finding: The finding. Its unit is measured in nominal runs if its monitor needs that.
            driving: Messages played to the system in these runs; see `chain.base.external.driving_log`.

        Raises:
            EnvironmentFaultError: The system does not start.
        """
        if not needs_baseline(finding.monitor):
            return None, ""
        unit, pace = finding.unit, self.context.file.system.trial_run
        baseline = self.runners.in_system(unit, lambda: self.unit_log(unit), pace, driving)
        return (unit, baseline), why_not_told(baseline, finding.monitor, finding.signature)

    @property
    def findings(self) -> Path:
        """Folder of all findings."""
        return self.out / "findings"


def open_finding(path: Path) -> tuple[Path, FindingRecord]:
    """Find a finding by its folder, or the only one in an output folder.

    Raises:
        ConfigError: There is none, or there are several.
    """
    if record := FindingRecord.find(path):
        return path, record
    inside = FindingRecord.folders(path / "findings")
    if len(inside) == 1:
        return inside[0], FindingRecord.load(inside[0])
    if not inside:
        near = did_you_mean(path.name, [folder.name for folder in FindingRecord.folders(path.parent)])
        raise ConfigError(f"no finding at {str(path)!r}", hint=near or "run `riot test` first, or name its folder")
    names = ", ".join(str(folder) for folder in inside[:5])
    raise ConfigError(f"{len(inside)} findings in {str(path)!r}", hint=f"name one of: {names}")
