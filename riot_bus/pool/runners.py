"""Factories of the runners of a chain: with processes of this machine, or with replacements for them."""

from __future__ import annotations

import os
import shutil
import threading
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from riot_bus.pool.kept_baselines import KeptBaselines
from riot_bus.pool.local import LocalRunner, Pool
from riot_bus.pool.nominal import measure_baseline, measure_in_system
from riot_bus.trial.baseline import UNKNOWN
from riot_bus.trial.evidence import DEBUGGER, has_debugger, native_backtrace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import UnitTrial

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from riot_bus.pool.local import WorkerSource
    from riot_bus.pool.wire import Trial
    from riot_bus.system.system_file import RunPace
    from riot_bus.trial.baseline import Baseline
    from riot_bus.trial.context import Context
    from riot_bus.trial.hangs import KnownHangs
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Runner, TestCase

_EVIDENCE_TRIALS = 5
_MOST_SLOTS = 4
"""Trials at once for each processor: more of them cost memory, and wake up at the same time."""


def slots_for(busy: float, processors: int) -> int:
    """Return how many trials run at once if each takes a share of a processor: at least one on each processor.

    Args:
        busy: Processor time of a trial in seconds per second; 0 if that is not known.
        processors: Number of processors.
    """
    return max(processors, min(_MOST_SLOTS * processors, int(processors / busy))) if busy > 0 else processors


class RunnerFactory(Protocol):
    """Gives the runners that answer the questions of a chain."""

    def unit(self, unit: str, log: Callable[[], Sequence[Message]]) -> Runner:
        """Return a runner for trials of a unit alone.

        Args:
            unit: Name of the unit.
            log: Function that returns the nominal log, which the baseline is measured with; called when first needed.
        """
        ...

    def baseline(self, unit: str, log: Callable[[], Sequence[Message]]) -> Baseline:
        """Return the baseline of a unit, which is measured once; takes the arguments of `unit`."""
        ...

    def in_system(
        self, unit: str, log: Callable[[], Sequence[Message]], pace: RunPace, driving: tuple[Message, ...]
    ) -> Baseline:
        """Return the baseline of a unit in nominal runs of the whole system, which is measured once."""
        ...

    def keep_evidence(
        self, unit: str, case: TestCase, signature: str, folder: Path, *, in_system: Baseline | None = None
    ) -> bool:
        """Repeat a failing case until it fails with the same signature again, and keep the evidence of that trial.

        Args:
            unit: Name of the unit.
            case: The failing test case.
            signature: Signature of the failure.
            folder: Folder for the evidence.
            in_system: Baseline of the unit in runs of the whole system, if trials are such runs.

        Returns:
            False if it did not fail with this signature in a few trials; then nothing is kept.
        """
        ...

    def system(
        self,
        pace: RunPace,
        *,
        observe: Sequence[str] = (),
        record: Path | None = None,
        judged: tuple[str, Baseline] | None = None,
        timed: bool = True,
    ) -> Runner:
        """Return a runner for runs of the whole system.

        Args:
            pace: Duration and speed of external components.
            observe: Fields (`topic:field`) whose values are kept, and topics of which only the times are kept.
            record: File that gets every message of a run; None for none.
            judged: Unit to judge, and its baseline in nominal runs (from `in_system`).
            timed: Whether causes are inferred from times, which more runs at once than processors would blur.
        """
        ...

    def close(self) -> None:
        """Release everything that runners use."""
        ...


class LocalRunners:
    """Factory of runners that start the components of a system as processes of this machine, or where workers are.

    Args:
        jobs: Number of trials at once; 0 for one on each processor, and more for units that mostly wait.
        workers: Function that returns a source of workers to use instead of this machine; called when first needed.
        keep: Folder in which the files of failing trials, and the baselines, are kept.
        fresh: Whether to measure baselines anew instead of reading them there.
    """

    def __init__(
        self,
        context: Context,
        *,
        jobs: int,
        keep: Path,
        fresh: bool = False,
        workers: Callable[[], WorkerSource] | None = None,
    ) -> None:
        self._context, self._keep, self._fresh, self._workers = context, keep, fresh, workers
        self._processors, self._spread = jobs or os.cpu_count() or 1, not (jobs or fresh or workers)
        self._started: Pool | None = None
        self._hangs: dict[str, KnownHangs] = {}
        self._kept_hangs: dict[str, KnownHangs] = {}
        self._baselines: dict[str, Baseline] = {}
        self._in_system: dict[tuple[str, str], Baseline] = {}
        self._measuring = threading.Lock()

    @property
    def _pool(self) -> Pool:
        """The processes that run trials, started when first needed."""
        if self._started is None:
            workers = self._workers and self._workers()
            self._started = Pool(
                self._context.file.path, self._processors, keep=self._keep, workers=workers, hangs=self._hangs
            )
        return self._started

    @cached_property
    def _kept(self) -> KeptBaselines:
        return KeptBaselines(self._keep / "baselines", self._context.fingerprint())

    def _measured(self, unit: str, where: str, log: Sequence[Message], measure: Callable[[], Baseline]) -> Baseline:
        return measure() if self._fresh else self._kept.get(unit, where, log, measure)

    def unit(self, unit: str, log: Callable[[], Sequence[Message]]) -> LocalRunner:
        """Return a runner for trials of a unit alone; what the unit does in nominal trials is measured once."""

        def trial() -> Trial:
            return UnitTrial(unit, self.baseline(unit, log))

        def slots(_: float) -> int:
            return slots_for(self.baseline(unit, log).busy, self._processors) if self._spread else self._pool.jobs

        return LocalRunner(trial, self._pool, slots)

    def baseline(self, unit: str, log: Callable[[], Sequence[Message]]) -> Baseline:
        """Return what a unit does in nominal trials; see `RunnerFactory.baseline`."""
        with self._measuring:
            if unit not in self._baselines:
                messages = log()
                self._baselines[unit] = self._measured(
                    unit, "alone", messages, lambda: measure_baseline(self._context, unit, self._pool, messages)
                )
                if not self._fresh:
                    self._kept_hangs[unit] = self._kept.hangs(unit, messages)
                    self._hangs.setdefault(self._context.file.component_of(unit), self._kept_hangs[unit])
            return self._baselines[unit]

    def in_system(
        self, unit: str, log: Callable[[], Sequence[Message]], pace: RunPace, driving: tuple[Message, ...]
    ) -> Baseline:
        """Return what a unit does in nominal runs of the whole system; see `RunnerFactory.in_system`."""
        alone, key = self.baseline(unit, log), (unit, pace.model_dump_json())
        with self._measuring:
            if key not in self._in_system:
                self._in_system[key] = self._measured(
                    unit,
                    key[1],
                    alone.log,
                    lambda: measure_in_system(self._context, unit, self._pool, alone, pace, driving),
                )
            return self._in_system[key]

    def keep_evidence(
        self, unit: str, case: TestCase, signature: str, folder: Path, *, in_system: Baseline | None = None
    ) -> bool:
        """Keep what a failing trial leaves; see `RunnerFactory.keep_evidence`."""
        baseline, pace = self._baselines.get(unit, UNKNOWN), self._context.file.system.trial_run
        partial = folder.with_suffix(".partial")
        for attempt in range(_EVIDENCE_TRIALS):
            shutil.rmtree(partial, ignore_errors=True)
            alone, whole = UnitTrial(unit, baseline, evidence=True), SystemTrial(pace, evidence=True)
            if in_system is not None and in_system.trials:
                whole = replace(whole, unit=unit, baseline=in_system)
            trial = alone if in_system is None else whole
            outcome = self._pool.execute(trial, replace(case, again=-1 - attempt), into=partial)
            if outcome.failed_as(signature):
                if "SIG" in signature and in_system is None and has_debugger():
                    self._add_backtrace(alone, case, partial)
                shutil.rmtree(folder, ignore_errors=True)
                partial.rename(folder)
                return True
        shutil.rmtree(partial, ignore_errors=True)
        return False

    def _add_backtrace(self, trial: UnitTrial, case: TestCase, folder: Path) -> None:
        """Run the case once more behind a debugger, and keep the native stacks that it prints."""
        inside = folder / "debugger"
        self._pool.execute(replace(trial, before=DEBUGGER), case, into=inside)
        texts = [native_backtrace(path.read_text(errors="replace")) for path in inside.glob("*.stdout.txt")]
        shutil.rmtree(inside, ignore_errors=True)
        if any(texts):
            (folder / "backtrace.txt").write_text("\n".join(texts) + "\n", encoding="utf-8")

    def system(
        self,
        pace: RunPace,
        *,
        observe: Sequence[str] = (),
        record: Path | None = None,
        judged: tuple[str, Baseline] | None = None,
        timed: bool = True,
    ) -> LocalRunner:
        """Return a runner for runs of the whole system; see `RunnerFactory.system`."""
        unit, baseline = judged or ("", UNKNOWN)
        trial = SystemTrial(pace, tuple(observe), record is not None, unit=unit, baseline=baseline)
        timed = timed and self._context.file.system.clock is None
        if timed or not self._spread:
            return LocalRunner(lambda: trial, self._pool, lambda _: self._pool.jobs, into=record)
        # The load of runs varies from day to day, but the questions of a search must not: a batch has a fixed size.
        batch = 2 * self._processors  # runs wait for about as long as they work

        def slots(busy: float) -> int:
            return min(batch, slots_for(busy, self._processors))

        return LocalRunner(lambda: trial, self._pool, slots, into=record, batch=batch)

    def close(self) -> None:
        """Kill what still runs, and keep what is known of hangs for later commands."""
        if self._started is not None:
            self._started.close()
        for unit, before in self._kept_hangs.items():
            known = self._hangs[self._context.file.component_of(unit)]
            if known != before:
                self._kept.keep_hangs(unit, self._baselines[unit].log, known)
